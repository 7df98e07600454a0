"""Geodesy and coast: projections, and simplification of land."""
