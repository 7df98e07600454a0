"""Shared by several formats: the run's result, legs, figures along a route, text."""
