"""Hard-over turns: contingency simulation, verification of a route, closest approach."""
