"""The passage that is steered: a few waypoints of a route, with limits of each leg."""
