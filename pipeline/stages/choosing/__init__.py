"""What is chosen where a scenario leaves it out: the region, the offing, and when to leave."""
