"""A Marine Data Store on this machine, for the unmodified Copernicus Marine client.

It has the datasets of the catalogue, serves an ocean whose currents are given by a formula, and can
be made to fail in each of the ways in which the real one does.
"""
