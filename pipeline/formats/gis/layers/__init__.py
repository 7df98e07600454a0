"""The layers of a run: what each holds, its columns and their meanings."""
