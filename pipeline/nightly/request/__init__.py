"""What is asked: the configuration, and the cases that come of it."""
