"""The lower bound on fuel behind the optimality gap."""
