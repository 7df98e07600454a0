"""A voyage in one line: turns what a person types into a scenario, and runs it."""
