"""Maps: their frame, layers, arrows of the current and labels of islands."""
