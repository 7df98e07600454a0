"""Routes for a bridge, a plotter, a phone: RTZ, GPX and GeoJSON over the same waypoints."""
