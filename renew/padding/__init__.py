"""Adaptive padding of constrained edges, and the soft no-go zone V."""
