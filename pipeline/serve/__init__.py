"""A page and an HTTP interface on this machine, where people and programs plan voyages."""
