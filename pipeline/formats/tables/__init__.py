"""Tables and metadata: metrics.csv, currents (NetCDF), manifest.json."""
