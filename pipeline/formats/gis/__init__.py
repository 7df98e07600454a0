"""`routes.gpkg`: the results for a GIS."""
