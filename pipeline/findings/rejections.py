"""Rejected classes of a case, described for JSON."""

import renew
from pipeline.findings.note_words import note_value
from pipeline.findings.result import RunCase
from pipeline.model import Water
from renew.errors import Strait


def rejections(case: RunCase) -> list[dict[str, object]]:
    """Describe the rejected classes of a case for JSON, in the order of their rejection.

    `kind` is the class of the error behind a reason; `places` are the positions that the reason
    names, in degrees, or metres in a plane; `moments` are dates, or seconds if no date is known;
    `lengths_m` are true metres.
    """
    return [_rejection(case, one) for one in case.plan.rejected] if case.plan else []


def _rejection(case: RunCase, rejected: renew.Rejected) -> dict[str, object]:
    """Describe one rejected class for JSON."""
    water = case.run.water
    return {
        "class": rejected.homotopy,
        "kind": type(rejected.cause).__name__ if rejected.cause else None,
        "reason": case.rejection_reason(rejected),
        "places": [note_value(water.place(place)) for place in rejected.text.places],
        "moments": [note_value(case.case.moment(one.seconds)) for one in rejected.text.moments],
        "lengths_m": [water.projection.scale * one.metres for one in rejected.text.lengths],
        "strait": None if rejected.strait is None else _strait(water, rejected.strait),
    }


def _strait(water: Water, strait: Strait) -> dict[str, object]:
    """Return the gap that padding fills: its banks, width and both paddings, true metres."""
    scale = water.projection.scale
    return {
        "banks": [note_value(water.place(bank)) for bank in strait.gap],
        "width_m": water.projection.geodesic_length_m(strait.gap),
        "padding_left_m": strait.padding_left * scale,
        "padding_right_m": strait.padding_right * scale,
    }
