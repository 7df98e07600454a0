"""Classes without a route as values: kind of reason, places, moments; and the sentence about it."""

from datetime import timedelta

import renew
from pipeline._types import FloatArray
from pipeline.formats.shared.result import RunResult
from renew.errors import Strait


def rejections(result: RunResult, season: str) -> list[dict[str, object]]:
    """Describe the rejected classes of a season for JSON, in the order in which they were rejected.

    `kind` is the class of the error behind a reason; `places` are the positions that the reason
    names, degrees, or metres in a plane; `moments` are dates, or seconds where none is known.
    """
    plans = (entry.plan for entry in result.plans if entry.season == season and entry.plan)
    return [_rejection(result, season, one) for plan in plans for one in plan.rejected]


def _rejection(result: RunResult, season: str, rejected: renew.Rejected) -> dict[str, object]:
    """Describe one of them."""
    departure = result.scene.departures.get(season)
    seconds = [moment.seconds for moment in rejected.text.moments]
    return {
        "class": rejected.homotopy,
        "kind": type(rejected.cause).__name__ if rejected.cause else None,
        "reason": result.rejection_reason(season, rejected),
        "places": [_position(result, place) for place in rejected.text.places],
        "moments": [
            one if departure is None else (departure + timedelta(seconds=round(one))).isoformat()
            for one in seconds
        ],
        "strait": None if rejected.strait is None else _strait(result, rejected.strait),
    }


def _position(result: RunResult, place: FloatArray) -> dict[str, float]:
    """A place (2,) of the plane, as the scenario gives positions."""
    if result.scene.is_planar:
        return {"x_m": float(place[0]), "y_m": float(place[1])}
    lon, lat = result.scene.projection.to_lonlat(place)
    return {"lon": float(lon), "lat": float(lat)}


def _strait(result: RunResult, strait: Strait) -> dict[str, object]:
    """The gap that padding takes whole: its banks, and what they need, true metres."""
    scale = result.scene.projection.scale
    return {
        "banks": [_position(result, bank) for bank in strait.gap],
        "width_m": result.scene.projection.geodesic_length_m(strait.gap),
        "padding_left_m": strait.padding_left * scale,
        "padding_right_m": strait.padding_right * scale,
    }
