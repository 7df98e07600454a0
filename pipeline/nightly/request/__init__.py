"""The request: the configuration, and the cases that it expands to."""
