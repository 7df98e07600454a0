"""What the page says of a run: seasons, comparisons, what is not known."""
