"""Depths on a grid: which water is too shallow for the vessel."""
