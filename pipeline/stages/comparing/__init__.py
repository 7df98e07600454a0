"""Compare all seasons' routes: names of ways, bounds for other ways, and doubtful routes."""
