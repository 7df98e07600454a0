"""Data of the page's interactive map."""
