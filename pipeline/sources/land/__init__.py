"""Adapters for land and charts: OpenStreetMap, S-57 cells, vector files, overlays of them."""
