"""The user's own files of currents, by the CF conventions."""
