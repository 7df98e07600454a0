"""How a coast of a hundred thousand vertices becomes some hundred, with no land uncovered."""
