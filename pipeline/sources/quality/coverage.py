"""Bounds of regions and of grids of currents: how far one reaches beyond the other."""

from collections.abc import Sequence

from pipeline._types import FloatArray

Bounds = tuple[float, float, float, float]
"""West, south, east, north in degrees."""

# Cells that a source adds around the region, so that currents at its edge are interpolated.
MARGIN_CELLS = 2.5


def widened(bounds: Bounds, lon_deg: float, lat_deg: float) -> Bounds:
    """Bounds with a margin on each side."""
    west, south, east, north = bounds
    return west - lon_deg, south - lat_deg, east + lon_deg, north + lat_deg


def cell_bounds(lon: FloatArray, lat: FloatArray, cell_deg: tuple[float, float]) -> Bounds:
    """Outer edges of the cells around a grid's ascending nodes: half a cell beyond these."""
    nodes = (float(lon[0]), float(lat[0]), float(lon[-1]), float(lat[-1]))
    return widened(nodes, cell_deg[0] / 2, cell_deg[1] / 2)


def around_missing(steps: Sequence[str], missing: str) -> str:
    """Say between which steps, by their ascending labels, one is missing; empty at an end."""
    before = [step for step in steps if step < missing]
    after = [step for step in steps if step > missing]
    return f", between {before[-1]} and {after[0]}" if before and after else ""


def sides_beyond(region: Bounds, grid: Bounds) -> list[str]:
    """Name each side on which a region reaches beyond a grid, with the grid's limit there."""
    return [
        f"{side} of {limit:g} (the region reaches {reached:g})"
        for side, limit, reached, is_beyond in (
            ("west", grid[0], region[0], region[0] < grid[0]),
            ("south", grid[1], region[1], region[1] < grid[1]),
            ("east", grid[2], region[2], region[2] > grid[2]),
            ("north", grid[3], region[3], region[3] > grid[3]),
        )
        if is_beyond
    ]


def common_bounds(one: Bounds, other: Bounds) -> Bounds | None:
    """Bounds of what two bounds have in common; None where that is nothing."""
    west, south = max(one[0], other[0]), max(one[1], other[1])
    east, north = min(one[2], other[2]), min(one[3], other[3])
    return (west, south, east, north) if west < east and south < north else None
