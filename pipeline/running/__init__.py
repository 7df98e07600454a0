"""What is around a run: its exclusive use of an output folder, what it reports, its outcome."""
