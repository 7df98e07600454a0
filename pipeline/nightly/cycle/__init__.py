"""A night's files on the disk: finished and unfinished cycles, the lock, yesterday's routes."""
