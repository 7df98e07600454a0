"""What lies on the disk: cycles, the one under way with its parts, the lock, yesterday's routes."""
