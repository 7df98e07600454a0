"""Rejected classes of a season, described for JSON."""

import renew
from pipeline.findings.note_words import note_value
from pipeline.findings.result import RunResult
from renew.errors import Strait


def rejections(result: RunResult, season: str) -> list[dict[str, object]]:
    """Describe the rejected classes of a season for JSON, in the order of their rejection.

    `kind` is the class of the error behind a reason; `places` are the positions that the reason
    names, in degrees, or metres in a plane; `moments` are dates, or seconds if no date is known;
    `lengths_m` are true metres.
    """
    plan = result.plan_of(season)
    return [_rejection(result, season, one) for one in plan.rejected] if plan else []


def _rejection(result: RunResult, season: str, rejected: renew.Rejected) -> dict[str, object]:
    """Describe one rejected class for JSON."""
    return {
        "class": rejected.homotopy,
        "kind": type(rejected.cause).__name__ if rejected.cause else None,
        "reason": result.rejection_reason(season, rejected),
        "places": [note_value(result.scene.place(place)) for place in rejected.text.places],
        "moments": [
            note_value(result.scene.moment(season, one.seconds)) for one in rejected.text.moments
        ],
        "lengths_m": [result.scene.projection.scale * one.metres for one in rejected.text.lengths],
        "strait": None if rejected.strait is None else _strait(result, rejected.strait),
    }


def _strait(result: RunResult, strait: Strait) -> dict[str, object]:
    """Return the gap that padding fills: its banks, width and both paddings, true metres."""
    scale = result.scene.projection.scale
    return {
        "banks": [note_value(result.scene.place(bank)) for bank in strait.gap],
        "width_m": result.scene.projection.geodesic_length_m(strait.gap),
        "padding_left_m": strait.padding_left * scale,
        "padding_right_m": strait.padding_right * scale,
    }
