"""What a run writes: one module a format, each a function of the finished run and a path."""
