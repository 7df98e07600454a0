"""Scenarios and the catalogue as strict models, and messages about what is wrong in them."""
