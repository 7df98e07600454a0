"""Quality checks of current fields: acceptance, plausibility, misregistration, signs."""
