"""When to leave: the best route by departure, and around areas that are shut for some hours."""
