"""Scenarios and the catalogue as strict models, messages about faults in them, and reference."""
