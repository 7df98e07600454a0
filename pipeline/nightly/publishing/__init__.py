"""The published files: tables, map layers, the page, the changes, and the record."""
