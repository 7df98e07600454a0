"""What is chosen where a scenario leaves it out: the region and the offing."""
