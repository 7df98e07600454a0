"""One referee for all planners: fuel, clearance, steering and hard-over turns."""
