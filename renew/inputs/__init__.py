"""The inputs of a plan: chart, shut areas, current, vessel, and the request with its options."""
