"""Tables and metadata: metrics.csv, currents.nc, manifest.json."""
