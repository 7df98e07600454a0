"""Reduces a coast of a hundred thousand vertices to some hundreds that still cover all land."""
