"""Sources of land and currents: adapters behind two small interfaces, chosen in `registry`."""
