"""What is published: tables, map layers, the page, what changed, and how it was made."""
