"""`routes.gpkg`: what a GIS opens."""
