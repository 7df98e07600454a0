"""Under way with the results of a finished run: watch the vessel's positions, plan again."""
