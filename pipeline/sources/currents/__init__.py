"""Adapters for currents: embedded tables, CF files, Copernicus Marine."""
