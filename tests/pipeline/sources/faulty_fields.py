"""Synthetic fields for the quality checks, and the faults that real files have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.sources.current_field import Field

# Among the islands between Borneo and Luzon, and off Japan: coasts on all sides, and open sea.
ISLANDS = np.arange(112.0, 130.0, 0.25), np.arange(2.0, 18.0, 0.25)
OCEAN = np.arange(140.0, 160.0, 0.25), np.arange(20.0, 38.0, 0.25)


def with_u_flipped(field: Field) -> Field:
    """Change the sign of the eastward component."""
    return replace(field, u=-field.u)


def with_v_flipped(field: Field) -> Field:
    """Change the sign of the northward component."""
    return replace(field, v=-field.v)


def with_both_flipped(field: Field) -> Field:
    """Change both signs."""
    return replace(field, u=-field.u, v=-field.v)


def swapped(field: Field) -> Field:
    """Swap the components."""
    return replace(field, u=field.v, v=field.u)


def rotated(field: Field) -> Field:
    """Swap the components and change one sign."""
    return replace(field, u=field.v, v=-field.u)


def shifted(field: Field, east: float, north: float) -> Field:
    """Shift a field by degrees, as wrong coordinates do."""
    return replace(field, lon=field.lon + east, lat=field.lat + north)
