"""Make room to turn: add padding where a path can't be steered, and refine the path again."""

import contextlib

import numpy as np

from renew._types import FloatArray
from renew.errors import InfeasibleError
from renew.paths.corridor import Corridor
from renew.paths.least_fuel_path import refined_path
from renew.steering.steer_in_corridor import steer_in_corridor, steer_thinned_in_places

# Maximum number of times that padding is increased where a path can't be steered.
_MAX_WIDENINGS = 16
# First and largest increase of the padding, and its reach around a place, in multiples of v/ω.
_WIDENING, _WIDEST, _AROUND = 0.15, 4.0, 3.0


def steered_as_it_is(
    corridor: Corridor, path: FloatArray
) -> tuple[Corridor, FloatArray, FloatArray]:
    """Return the corridor, the path (n, 2), and the trajectory (m, 4) steered in the corridor."""
    return corridor, *steer_in_corridor(path, corridor)


def steered_with_room(
    corridor: Corridor, path: FloatArray
) -> tuple[Corridor, FloatArray, FloatArray]:
    """Return a corridor with room to turn, a path (n, 2) in it, and its trajectory (m, 4).

    A path without padding wraps corners closely, which may leave no room to round them. Where it
    can't be steered, the edges nearby get more padding, and the path is refined again. If no edge
    is nearby, or padding doesn't help, the path is thinned there.
    """
    radius, tried = corridor.voyage.vessel.turning_radius, path
    used, places, widths = corridor, np.empty((0, 2)), np.empty(0)
    first: InfeasibleError | None = None
    for _ in range(_MAX_WIDENINGS):
        try:
            if first is not None:
                tried = refined_path(used, tried)
            return steered_as_it_is(used, tried)
        except InfeasibleError as error:
            first = first or error
            if not error.places:
                break
            # Each place gets twice the room that it had before.
            place = error.places[0]
            given = widths[np.linalg.norm(places - place, axis=1) < _AROUND * radius]
            width = max(2 * given.max(initial=0.0), _WIDENING * radius)
            if width > _WIDEST * radius:
                break
            places, widths = np.vstack([places, place]), np.append(widths, width)
            wider = [one.widened(places, widths, _AROUND * radius) for one in corridor.paddings]
            if all(len(a.edge) == len(b.edge) for a, b in zip(wider, used.paddings, strict=True)):
                # No edge is nearby.
                break
            used = corridor.with_padding(wider)
    with contextlib.suppress(InfeasibleError):
        return corridor, *steer_thinned_in_places(path, corridor)
    raise first or InfeasibleError("no attempt was made")
