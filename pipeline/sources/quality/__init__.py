"""Checks of a current's figures: acceptance, plausibility, shift, component signs."""
