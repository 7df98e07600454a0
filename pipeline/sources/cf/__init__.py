"""Currents from the user's own files, by the CF conventions, and GRIB."""
