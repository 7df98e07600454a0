"""What a plan consists of, and how a notebook shows it."""
