"""Environments as data: scenes in metres, what is ours in them, and what was published for them."""
