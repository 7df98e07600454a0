"""The clearance of a class, which yields in narrows.

Where no part of a section across the channel keeps the whole clearance, the land around it keeps a
share of its distance from the middle of the passage instead. The padding for turns never yields.
"""

import numpy as np
import shapely

from renew._types import FloatArray
from renew.classes.dual_graph import Channel
from renew.classes.triangulation import Triangulation
from renew.kernels.capsules import Capsules
from renew.paths.sections import Sections, free_parts, sections_of
from renew.turns.padding_model import PaddedEdges
from renew.voyage.voyage import Voyage

# Spacing of sections, and length of the pieces of shore that yield, as a share of the clearance.
_SPACING = 0.25
# Largest turn between two sections, rad.
_ANGLE = np.radians(15)
# Places on a section that are compared to find its middle, as shares of it.
_PLACES = np.linspace(0.0, 1.0, 25)[1:-1]


def with_clearance(
    padded: PaddedEdges,
    clearance: float,
    share: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
) -> PaddedEdges:
    """Return padding with a clearance (m) at least, which yields in narrows.

    Parameters
    ----------
    padded
        Edges within the clearance of a channel without via points; their padding is for turns.
    share
        Share of its distance from the middle of a narrow that the shore keeps; 1: the clearance
        yields nowhere.
    """
    whole = padded.at_least(np.full(len(padded.edge), clearance))
    if share == 1.0 or clearance == 0.0:
        return whole
    middles = _middles_of_narrows(whole, clearance, channel, voyage, triangulation)
    if not len(middles):
        return whole
    reach = clearance / share
    yields = shapely.dwithin(_lines(padded), shapely.MultiPoint(middles), reach)
    pieces = padded.select(yields).cut(_SPACING * clearance)
    tree = shapely.STRtree(shapely.points(middles))
    apart = np.full(len(pieces.edge), clearance / share)
    found, distance = tree.query_nearest(
        _lines(pieces), max_distance=reach, return_distance=True, all_matches=False
    )
    apart[found[0]] = distance
    kept = pieces.at_least(share * apart)
    # Each edge's first row has its padding for turns, which may grow.
    first = padded.at_least(np.where(yields, 0.0, clearance))
    return PaddedEdges.stacked([first, kept])


def _middles_of_narrows(
    whole: PaddedEdges,
    clearance: float,
    channel: Channel,
    voyage: Voyage,
    triangulation: Triangulation,
) -> FloatArray:
    """Return the middles (n, 2) of sections that V takes whole, and ends of the voyage inside V."""
    capsules = Capsules(whole.start, whole.end, whole.padding)
    ends = np.stack([voyage.start, voyage.goal])
    spacing = _SPACING * clearance
    sections = _blocked(channel, voyage, spacing, capsules)
    middles, room = _middles(sections, triangulation)
    finer = float(room.min(initial=np.inf))
    if 0.0 < finer < spacing:
        middles, _ = _middles(_blocked(channel, voyage, finer, capsules), triangulation)
    inside = [len(whole.around(end).edge) > 0 for end in ends]
    return np.concatenate([middles, ends[inside]])


def _blocked(channel: Channel, voyage: Voyage, spacing: float, capsules: Capsules) -> Sections:
    """Return the sections at most `spacing` m apart that capsules take whole."""
    sections = sections_of(channel, voyage.start, voyage.goal, spacing, _ANGLE)
    return sections.select(free_parts(sections, capsules).blocked)


def _middles(sections: Sections, triangulation: Triangulation) -> tuple[FloatArray, FloatArray]:
    """Return each section's point furthest from land (n, 2), and how far off that is (n,), m."""
    points = sections.points(np.broadcast_to(_PLACES, (len(sections.left), len(_PLACES))))
    room = np.full(points.shape[:2], np.inf)
    if room.size:
        found, distance = triangulation.constrained_edge_tree.query_nearest(
            shapely.points(points.reshape(-1, 2)), return_distance=True, all_matches=False
        )
        room.flat[found[0]] = distance
    best = room.argmax(axis=1)
    row = np.arange(len(best))
    return points[row, best], room[row, best]


def _lines(edges: PaddedEdges) -> FloatArray:
    """Return the edges as lines."""
    return np.asarray(shapely.linestrings(np.stack([edges.start, edges.end], axis=1)))
