"""Rings for the tests of coasts; some cross themselves once they are simplified."""

from __future__ import annotations

import numpy as np
import shapely
from hypothesis import strategies as st

from tests.pipeline.archipelagos import PLANE, archipelagos


def planar(land: list[shapely.Polygon]) -> np.ndarray:
    """Return valid polygons in the plane, m."""
    valid = shapely.get_parts(shapely.make_valid(np.array(land, dtype=object)))
    polygons = valid[shapely.get_type_id(valid) == shapely.GeometryType.POLYGON]
    return np.asarray(PLANE.geometry_to_plane(polygons))


@st.composite
def combs(draw: st.DrawFn) -> shapely.Polygon:
    """Draw a coast (m) with inlets and spits that are narrower than what is cut."""
    depth = draw(st.lists(st.floats(1.0, 900.0), min_size=6, max_size=30))
    x = np.linspace(0.0, 40.0 * len(depth), len(depth))
    lean = draw(st.floats(-300.0, 300.0))
    tips = np.column_stack([x + lean, depth])
    roots = np.column_stack([x + draw(st.floats(0.1, 20.0)), np.full(len(x), -5.0)])
    shore = np.stack([tips, roots], axis=1).reshape(-1, 2)
    ring = shapely.Polygon([*shore, (x[-1], -2_000.0), (x[0], -2_000.0)])
    parts = shapely.get_parts(shapely.make_valid(ring, method="structure"))
    return max(parts.tolist(), key=lambda part: part.area)


coasts = st.one_of(archipelagos.map(planar), combs().map(lambda comb: np.array([comb])))
