"""Random islands in lon/lat for tests of the simplification of land."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from hypothesis import strategies as st

from pipeline.geo.projection import Projection

# A hundredth of a degree is 1.1 km here, where the plane and the globe hardly differ.
REGION = shapely.box(0.0, 0.0, 0.5, 0.5)
PLANE = Projection.for_region(REGION)
EXTENT = PLANE.geometry_to_plane(REGION)


def blob(
    middle: tuple[float, float], radii: Sequence[float], thin: float, turn: float
) -> shapely.Polygon:
    """Return a star-shaped island, degrees; `thin` squeezes it into a sliver."""
    angle = np.linspace(0, 2 * math.pi, len(radii), endpoint=False)
    x, y = np.array(radii) * [np.cos(angle), thin * np.sin(angle)]
    turned = [x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)]
    return shapely.Polygon(np.column_stack(turned) + middle)


places = st.tuples(st.floats(-0.03, 0.53), st.floats(-0.03, 0.53))
islets = st.builds(
    blob,
    places,
    st.lists(st.floats(0.0002, 0.002), min_size=3, max_size=6),
    st.just(1.0),
    st.just(0.0),
)
islands = st.builds(
    blob,
    places,
    st.lists(st.floats(0.005, 0.12), min_size=3, max_size=24),
    st.sampled_from([1.0, 0.4, 0.01]),
    st.floats(0, math.pi),
)


@st.composite
def atolls(draw: st.DrawFn) -> shapely.Polygon:
    """Draw an island with a lake."""
    island = draw(islands)
    lake = shapely.affinity.scale(island, 0.6, 0.6, origin=island.centroid)
    return shapely.Polygon(island.exterior, [lake.exterior]) if lake.within(island) else island


archipelagos = st.lists(st.one_of(islets, islands, atolls()), min_size=1, max_size=12)

# How many examples a property is tried on: each takes a large part of a second.
EXAMPLES = pytest.mark.parametrize("examples", [10, pytest.param(150, marks=pytest.mark.slow)])
