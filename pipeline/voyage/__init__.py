"""A voyage in one line: from what a person types to a scenario, and to its results."""
