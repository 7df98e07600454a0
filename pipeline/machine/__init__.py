"""The machine that this runs on: paths that a user gave, and Python processes that are started."""
