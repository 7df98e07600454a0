"""What the routes of all seasons show together: their ways by name, other sides, shut straits."""
