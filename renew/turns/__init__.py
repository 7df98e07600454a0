"""Hard-over turns: their reach and the padding against it, simulation, verification."""
