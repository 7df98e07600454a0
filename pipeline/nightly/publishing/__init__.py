"""The published files: tables, a map layer, the changes, the page, and a catalogue item."""
