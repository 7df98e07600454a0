"""Land around a chart, for maps only: a coast that ended at the chart's edge would read as water.

It is the land of the world's shoreline, in no more detail than a map of the whole region shows.
"""

import math

import numpy as np
import shapely

from pipeline.geo.earth import METRES_PER_DEGREE
from pipeline.sources.land.osm import polygons_near
from pipeline.sources.land.shapes import box_around, clipped, extract_polygons, repaired

# Distance outside the region's bounds up to which maps show land, as a share of the longer side: a
# sheet of paper is at most that much wider than a tall region.
_REACH = 0.75
# Detail, as a share of the longer side: a quarter of a millimetre on a sheet with the region on it.
_DETAIL = 1e-3


def surroundings(region: shapely.Polygon) -> tuple[shapely.Polygon, ...]:
    """Return the land outside a region's bounds (lon/lat degrees), coarse.

    It reaches over the land that the sources fetch around the region, so that the two can be joined
    on maps without a gap.
    """
    west, south, east, north = region.bounds
    across = (east - west) * math.cos(math.radians((south + north) / 2))
    side_deg = max(across, north - south)
    wide = box_around(region, _REACH * side_deg * METRES_PER_DEGREE)
    detail = _DETAIL * side_deg
    near, _ = polygons_near("Osm", wide, least_deg=detail)
    # Clipped first: a continent has millions of vertices.
    cut = shapely.clip_by_rect(repaired(*near)[0], *wide.bounds)
    coarse = shapely.simplify(cut, detail, preserve_topology=False)
    valid = clipped(extract_polygons(repaired(coarse)[0]), wide)
    box = shapely.box(*region.bounds)
    reaches_in = shapely.intersects(box, valid)
    beyond = extract_polygons(shapely.difference(valid[reaches_in], box))
    return tuple(np.concatenate([valid[~reaches_in], beyond]).tolist())
