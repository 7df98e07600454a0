"""Homotopy classes: triangulation, dual graph, h-signature, and the k best channels."""
