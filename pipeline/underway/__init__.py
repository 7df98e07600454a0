"""Under way with the results of a finished run: where the vessel is, and to plan again."""
