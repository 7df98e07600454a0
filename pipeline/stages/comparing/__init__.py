"""Comparison of all seasons' routes: names of ways, ways not taken, and doubtful routes."""
