"""From what a person types to a scenario: positions, vessel, months, currents, region, offing."""
