"""Routes for an ECDIS, a plotter, a vehicle: RTZ, GPX, KML and missions with the same waypoints."""
