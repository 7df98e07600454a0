"""Class by class until k can be sailed: the problem, one class's plan, and the diagnosis."""
