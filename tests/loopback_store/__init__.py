"""A Marine Data Store on this machine, for the unmodified Copernicus Marine client.

It knows the datasets of the catalogue, serves an ocean whose currents are a formula, and can be
told to fail in each of the ways in which the real one does.
"""
