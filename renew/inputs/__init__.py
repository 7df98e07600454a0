"""What a plan is given: chart, current, vessel, areas, options, and the check of arguments."""
