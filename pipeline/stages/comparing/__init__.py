"""Comparison of all seasons' routes: names of ways, bounds on other sides, shut straits."""
