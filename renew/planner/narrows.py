"""Set the clearance of a class, reduced in narrows.

If all of a section across the channel lies within the clearance, the land around it keeps a share
of its distance from the middle of the passage instead. The padding for turns is never reduced.
"""

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.dual_graph import Channel
from renew.classes.triangulation import Triangulation
from renew.paths.sections import sections_of
from renew.turns.padding_model import PaddedEdges
from renew.voyage.voyage import Voyage

# Spacing of sections, and length of pieces of shore with reduced clearance, as a share of
# clearance.
_SPACING = 0.25
# Largest angle between two sections, rad.
_ANGLE = np.radians(15)
# Places on a section that are tried as its middle, as shares of its length.
_PLACES = np.linspace(0.0, 1.0, 17)[1:-1]
_FEW_PLACES = np.linspace(0.0, 1.0, 5)[1:-1]


def with_clearance(
    padded: PaddedEdges,
    clearance: float,
    share: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
) -> PaddedEdges:
    """Return padding of at least the clearance (m), reduced in narrows.

    Parameters
    ----------
    padded
        Edges within the clearance of a channel without via points; their padding is for turns.
    share
        Share of its distance from the middle of a narrow that the shore keeps; with 1 the clearance
        is never reduced.
    """
    whole = padded.at_least(np.full(len(padded.edge), clearance))
    # A passage with less room than turns need is shut, whatever the clearance.
    least = float(padded.padding.min(initial=clearance))
    if share == 1.0 or least == clearance:
        return whole
    middles = _middles_of_narrows(clearance, least, channel, voyage, triangulation)
    if not len(middles):
        return whole
    tree, reach = shapely.STRtree(shapely.points(middles)), clearance / share
    yields = np.isfinite(_apart(padded, tree, reach))
    pieces = padded.select(yields).cut(_SPACING * clearance)
    apart = np.minimum(_apart(pieces, tree, reach), reach)
    kept = pieces.at_least(share * apart)
    # Others lie in the padding of their whole edge, and would shut the way out of it at an end.
    kept = kept.select(kept.padding > pieces.padding)
    # Each edge's first row has its padding for turns, which may grow.
    first = padded.at_least(np.where(yields, 0.0, clearance))
    return PaddedEdges.stacked([first, kept])


def _middles_of_narrows(
    clearance: float,
    least: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
) -> FloatArray:
    """Return the middles (n, 2) of the sections and ends of a voyage with less room than clearance.

    Sections in narrows are as close as the least room there, down to `least` m, so that no narrow
    lies between two.
    """
    spacing = _SPACING * clearance
    middles, room = _narrow_sections(clearance, channel, voyage, triangulation, spacing)
    finer = max(least, float(room.min(initial=np.inf)))
    if 0.0 < finer < spacing:
        middles, _ = _narrow_sections(clearance, channel, voyage, triangulation, finer)
    ends = np.stack([voyage.start, voyage.goal])
    return np.concatenate([middles, ends[_room(ends, triangulation, clearance) < clearance]])


def _narrow_sections(
    clearance: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
    spacing: float,
) -> tuple[FloatArray, FloatArray]:
    """Return each narrow section's point furthest from land (n, 2), and how far off it is (n,), m.

    A section is narrow if none of its places keeps the clearance.
    """
    sections = sections_of(channel, voyage.start, voyage.goal, spacing, _ANGLE)
    # Most sections have room at one of few places.
    for places in (_FEW_PLACES, _PLACES):
        points = sections.points(np.broadcast_to(places, (len(sections.left), len(places))))
        room = _room(points, triangulation, clearance)
        narrow = room.max(axis=1, initial=0.0) < clearance
        sections, points, room = sections.select(narrow), points[narrow], room[narrow]
    row = np.arange(len(room))
    best = room.argmax(axis=1)
    return points[row, best], room[row, best]


def _room(points: FloatArray, triangulation: Triangulation, reach: float) -> FloatArray:
    """Return the distances (...,), m, of points (..., 2) from land; inf beyond the reach, m."""
    room = np.full(points.shape[:-1], np.inf)
    if room.size:
        found, distance = triangulation.constrained_edge_tree.query_nearest(
            shapely.points(points.reshape(-1, 2)),
            max_distance=reach,
            return_distance=True,
            all_matches=False,
        )
        room.flat[found[0]] = distance
    return room


def _apart(edges: PaddedEdges, tree: shapely.STRtree, reach: float) -> FloatArray:
    """Return the distances (e,), m, of edges from the nearest point of a tree; inf beyond reach."""
    lines = shapely.linestrings(np.stack([edges.start, edges.end], axis=1))
    found, distance = tree.query_nearest(
        lines, max_distance=reach, return_distance=True, all_matches=False
    )
    apart = np.full(len(edges.edge), np.inf)
    apart[found[0]] = distance
    return apart
