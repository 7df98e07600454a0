"""Find where routes cross land of a second shoreline, because there the two shorelines disagree.

The second shoreline, GSHHG, is older and in places coarser. A route that crosses its land may be
right, but the crossing is a reason to check an official chart.
"""

from collections.abc import Sequence

import numpy as np
import shapely

from pipeline._types import FloatArray
from pipeline.model import Note, Place, Scene, ShoreCrossing, of_seasons

# Minimum length of a crossing, true metres: a shorter one only grazes the shore.
_LEAST_M = 1.0
# Crossings whose positions agree to this many decimals of a degree (100 m) are one place.
_SAME_PLACE = 3


class SecondShoreline:
    """The land of a scene's second shoreline, with a spatial index."""

    def __init__(self, scene: Scene) -> None:
        self._projection = scene.projection
        self._shore = np.array(scene.second_shore, dtype=object)
        self._tree = shapely.STRtree(self._shore)

    def crossings(self, path: FloatArray, season: str, rank: int) -> tuple[ShoreCrossing, ...]:
        """Return where a path (n, 2), planar metres, crosses the second shoreline's land."""
        line = shapely.LineString(path)
        # Polygons that are valid in degrees may be invalid in the plane.
        crossed = shapely.make_valid(self._shore[self._tree.query(line, predicate="intersects")])
        over = shapely.get_parts(shapely.intersection(line, shapely.union_all(crossed)))
        found = []
        for part in over:
            length_m = self._projection.geodesic_length_m(shapely.get_coordinates(part))
            if length_m >= _LEAST_M:
                middle = shapely.line_interpolate_point(part, 0.5, normalized=True)
                lon, lat = self._projection.to_lonlat(shapely.get_coordinates(middle)[0])
                found.append(ShoreCrossing(season, rank, float(lon), float(lat), length_m))
        return tuple(found)


def crossing_notes(crossings: Sequence[ShoreCrossing]) -> tuple[Note, ...]:
    """Return a note for each season on the places where its routes cross the second shoreline.

    Crossings of the best route come first; the longest come first within both groups.
    """
    return of_seasons(
        {
            season: [Note.of("second-shoreline", crossings=_places(crossings, season))]
            for season in dict.fromkeys(one.season for one in crossings)
        }
    )


def _places(crossings: Sequence[ShoreCrossing], season: str) -> tuple[Note, ...]:
    """Return the places of a season, each with its longest crossing and all routes that cross."""
    there: dict[tuple[float, float], list[ShoreCrossing]] = {}
    for one in crossings:
        if one.season == season:
            place = round(one.lon, _SAME_PLACE), round(one.lat, _SAME_PLACE)
            there.setdefault(place, []).append(one)
    found = [
        (min(one.rank for one in group) > 1, max(group, key=lambda one: one.length_m), group)
        for group in there.values()
    ]
    return tuple(
        Note.of(
            "crossing",
            length_m=longest.length_m,
            place=Place(longest.lon, longest.lat),
            routes=tuple(sorted({one.rank for one in group})),
        )
        for _, longest, group in sorted(found, key=lambda one: (one[0], -one[1].length_m))
    )
