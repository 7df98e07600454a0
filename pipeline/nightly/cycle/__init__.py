"""A night's files on the disk: cycles, the cycle under way, the lock, yesterday's routes."""
