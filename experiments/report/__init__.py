"""One page that shows all tables and figures, offline."""
