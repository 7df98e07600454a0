"""Plan again under way: from where the vessel is, on its heading, in a newer current."""
