"""Choose what a scenario leaves out: the region, the offing, and the departure."""
