"""Output formats: one module each, with a function that writes a finished run to a path."""
