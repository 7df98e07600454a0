"""Turn a voyage in one line, as a person types it, into a scenario, and run it."""
