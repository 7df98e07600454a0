"""Where land and currents come from: adapters behind two small interfaces, chosen in `registry`."""
