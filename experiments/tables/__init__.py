"""From judged routes to tables."""
