"""Geodesy and coasts: projections, and simplification of land."""
