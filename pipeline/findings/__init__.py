"""What a run found, for readers: the result, its notes in words, names of ways, straits, sides."""
