"""What QGIS shows of the layers: styles, print layouts, the project that opens as a map."""
