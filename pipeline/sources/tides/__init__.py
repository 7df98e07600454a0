"""Stations of the tide: their constants from files, and constants that are fitted to series."""
