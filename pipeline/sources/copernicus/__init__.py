"""Currents of the Copernicus Marine Service, downloaded by its official client."""
