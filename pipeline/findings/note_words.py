"""The words of notes and of rejected classes, and how a note's values are put into them.

A note's words are a sentence for `str.format` in `notes.toml`, or a function of its values where
the sentence depends on them. Besides the usual formats there are those of `_FORMATS`, as
`{x:distance}`, `{n:route|routes}` for a count with its noun, `{list:, }` for a list with its
separator, and `{list:, /3/ and # more}` for a list of which only three entries are named.
"""

import math
import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from datetime import datetime
from typing import Any, TypeAlias

import renew
from pipeline.findings import text
from pipeline.findings.choices import departure_text, replanned_text, trade_off_text
from pipeline.findings.result import RunCase, RunResult
from pipeline.geo.projection import METRES_PER_DEGREE
from pipeline.model import Note, Place, Water
from pipeline.texts import table_beside
from renew.errors import Length, Moment, Strait

# A moment as a date, or in seconds on the clock of the current; None where it is not known.
_Moment: TypeAlias = datetime | float | None
MORE_CURRENTS = (
    "give a file of currents (--currents FILE, or its path in 'currents'), or plan without any "
    '(--currents still, or currents = ["still"])'
)
"""The remedy where currents cover too little."""


def note_text(note: Note) -> str:
    """Return a note as a sentence, without a full stop."""
    about = f"{', '.join(map(text.season_name, note.cases))}: " if note.cases else ""
    words, values = WORDS[note.kind], dict(note.values)
    return about + (words(**values) if callable(words) else _FORMATTER.vformat(words, (), values))


def note_texts(notes: Iterable[Note]) -> list[str]:
    """Return notes as sentences."""
    return [note_text(note) for note in notes]


def note_json(note: Note) -> dict[str, object]:
    """Return a note for JSON: the sentence, its kind, its cases, and its values."""
    values = {name: note_value(value) for name, value in note.values}
    return {
        "text": note_text(note),
        "kind": note.kind,
        "seasons": list(note.cases),
        "values": values,
    }


def note_value(value: object) -> object:
    """Return a value of a note for JSON: an object becomes its figures and names."""
    if isinstance(value, Note):
        return {"kind": value.kind, **{name: note_value(one) for name, one in value.values}}
    if isinstance(value, Place):
        names = ("x_m", "y_m") if value.is_planar else ("lon", "lat")
        return dict(zip(names, (value.x, value.y), strict=True))
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, tuple):
        return [note_value(one) for one in value]
    if is_dataclass(value):
        figures = {one.name: getattr(value, one.name) for one in fields(value)}
        plain = (str, int, float, datetime)
        return {name: note_value(one) for name, one in figures.items() if isinstance(one, plain)}
    return value


class _Formatter(string.Formatter):
    """Puts values into a sentence."""

    def format_field(self, value: Any, format_spec: str) -> str:  # noqa: ANN401 - as the base class
        """Return a value as text."""
        if format_spec in _FORMATS:
            return _FORMATS[format_spec](value)
        if "|" in format_spec:
            return text.count(value, *format_spec.split("|"))
        if isinstance(value, tuple):
            items = [note_text(one) if isinstance(one, Note) else str(one) for one in value]
            return _first(items, *format_spec.split("/"))
        return value.text if isinstance(value, Place) else format(value, format_spec)


_FORMATTER = _Formatter()
_FORMATS: Mapping[str, Callable[[Any], str]] = {
    "at most": lambda value: f"{text.rounded_up(value, 2):g}",
    "at most hours": text.at_most_hours,
    "moment": text.moment_text,
    **{name: getattr(text, name) for name in ("box", "distance", "clearance", "duration", "hours")},
    **{name: getattr(text, name) for name in ("number", "percent", "part", "share")},
}


def _first(items: Sequence[str], separator: str, most: str = "", more: str = "") -> str:
    """Join at most `most` items; `more` follows, with the number of the others in place of #."""
    named = items[: int(most)] if most else items
    rest = more.replace("#", str(len(items) - len(named))) if len(named) < len(items) else ""
    return separator.join(named) + rest


def _moment(moment: datetime | float) -> str:
    """Write a moment: a date, or seconds on the clock of the current."""
    return text.exact_moment_text(moment) if isinstance(moment, datetime) else f"{moment:.6g} s"


def _from_until(begin: _Moment, until: _Moment, on: str) -> str:
    """Say from when until when; `on` takes the place of an unknown end."""
    first = "" if begin is None else f" from {_moment(begin)}"
    return first + (on if until is None else f" until {_moment(until)}")


def _area_shut(area: str, begin: _Moment, until: _Moment) -> str:
    name = f"area {area!r}" if area else "an area"
    hours = _from_until(begin, until, "")
    when = f", which is shut{hours}" if hours else ", always shut"
    return (
        f"a way of less fuel leads through {name}{when}; a vessel that is early, on time or late "
        "might find it shut: the routes keep out of it (best without waiting)"
    )


def _least_water(
    least_m: float,
    early_m: float,
    late_m: float,
    at: _Moment,
    begin: _Moment,
    until: _Moment,
    place: Place,
) -> str:
    when = "" if at is None else f", at {_moment(at)}"
    hours = _from_until(begin, until, "")
    least, early, late = (text.rounded_down(one, 1) for one in (least_m, early_m, late_m))
    enough = f" There is enough water{hours}" if hours else " There is enough water at any time"
    return (
        f"the best route has {least} m under the keel where that is least, {place.text}"
        f"{when}; early {early} m, late {late} m.{enough}"
    )


def _tide_too_low(area: str, need_m: float, begin: _Moment, until: _Moment) -> str:
    hours = _from_until(begin, until, " at no time of the next 30 days")
    need = f"{text.rounded_up(need_m, 2):g} m"
    return (
        f"a way of less fuel leads over {area}, which needs {need} of tide; there is enough"
        f"{hours}: the routes keep off it (best without waiting)"
    )


def _water_shut_for_hours(
    share: float,
    speed_m_s: float,
    most_m_s: float,
    place: Place,
    hours: Sequence[Sequence[datetime]],
) -> str:
    times = [f"from {text.moment_text(a)} until {text.moment_text(b)}" for a, b in hours]
    shut = f"shut {_first(times, ', ', '3', ' and # more times')}"
    return (
        f"{share:.1%} of the water is shut for some hours by a current as fast as the vessel "
        f"({speed_m_s:.3g} m/s); where it is strongest, up to {text.rounded_up(most_m_s, 2):g} m/s "
        f"at {place.text}, {shut if times else 'before the vessel departs'}: routes are the best "
        "without waiting"
    )


def _shares(first: int, shares: Sequence[tuple[int, float]]) -> str:
    """Spell the share of the first route, and the largest share among the others."""
    texts = [f"{text.percent(share)} of route {rank}" for rank, share in shares if rank == first]
    if others := [one for one in shares if one[0] != first]:
        rank, largest = max(others, key=lambda one: one[1])
        others_too = f", the largest share of the {len(others)} other routes" * (len(others) > 1)
        texts.append(f"{text.percent(largest)} of route {rank}{others_too}")
    return " and ".join(texts)


def _crossing(length_m: float, place: Place, routes: Sequence[int]) -> str:
    named = f"route{'s' * (len(routes) > 1)} {', '.join(map(str, routes))}"
    return f"{length_m:,.0f} m at {place.text} on {named}"


def _strait_shut(place: Place, beside: Sequence[str], width_m: float, needed_m: float) -> str:
    land = f", beside {' and '.join(beside)}" if beside else ""
    width, needed = text.distance(width_m), text.distance(needed_m)
    return f"the one at {place.text}{land}, which is {width} wide where {needed} are needed"


def _adrift_kept(asked: str, ends: Sequence[tuple[str, float, float]]) -> str:
    """Say that a route keeps a limit of time adrift, and on which of its two ends it does not."""
    near = " and ".join(
        f"its {which} {text.distance(length_m)}, where it takes {text.duration(least_s)} at least"
        for which, length_m, least_s in ends
        if length_m > 0
    )
    but = f", but for {near}: the limit can't be had nearer to an end" if near else ""
    return (
        f"without thrust the current alone takes {asked} at least from the best route to "
        f"land of the region{but} (planner.adrift, --adrift)"
    )


def _narrow_stretch(
    rank: int,
    begin: Place,
    end: Place,
    length_m: float,
    side: str,
    no_go: str,
    width_m: float,
    place: Place,
    needed_m: float,
    kept_m: float,
) -> str:
    """Say where a route has no room for a hard-over turn, and what would fit."""
    wide = f"Near {place.text}"
    if math.isfinite(width_m):
        wide = f"The water at {place.text} is {text.distance(width_m)} wide, and"
    fits = "hardly any turning circle fits"
    if kept_m > 0:
        fits = f"the largest turning circle that fits is {text.distance(kept_m)}"
    return (
        f"no room to turn hard over on route {rank} for {text.distance(length_m)}, from "
        f"{begin.text} to {end.text}: a turn to {side} would meet {no_go}. {wide} a turn takes "
        f"{text.distance(needed_m)} to a side; at this speed {fits}: slow down, or take a tug"
    )


def _current_lacking(share: float, distance_m: float) -> str:
    return (
        f"the current has no data for {f'{share:.0%}' if share >= 0.01 else 'less than 1%'} of the "
        f"region's water, up to {math.ceil(distance_m / 1000)} km from the nearest "
        "value: it was filled from the water around"
    )


def _current_on_table(finest: float, step: float, *, is_turned: bool) -> str:
    turned = ", and turned from the lines of its grid to east and north" * is_turned
    coarser = f", where its finest cells are {_cell(finest)}" * (step > finest)
    return f"the current was put on axes with a node every {_cell(step)}{coarser}{turned}"


def _cell(degrees: float) -> str:
    return text.distance(METRES_PER_DEGREE * degrees)


def _ends(ends: Sequence[Note]) -> str:
    return f"{'; '.join(note_texts(ends))}. For more, {MORE_CURRENTS}"


def _region_chosen(bounds: Sequence[float], ends: Sequence[Note], left_out: float) -> str:
    rest = f"; {_ends(ends)}" if ends else ""
    longer = f"; it leaves out ways more than {left_out:g} times as long as the shortest"
    chosen = "chosen to hold the ways round the land between start and goal"
    return f"region {text.box(bounds)}, {chosen}{longer if left_out else ''}{rest}"


WORDS: Mapping[str, str | Callable[..., str]] = {
    **table_beside(__file__, "notes.toml"),
    "current-lacking": _current_lacking,
    "current-on-table": _current_on_table,
    "current-used": lambda source, valid: (
        f"planned on {source}{f', valid {valid}' if valid else ''}"
    ),
    "current-unknown": lambda left_out: (
        f"{'no current was used' if left_out else 'no current is given on the best route'}: real "
        "fuel and times may differ, and no choice of a way is proven"
    ),
    "tidal-streams": lambda names, step_min, error_m_s, has_mean: (
        f"tidal streams are the sum of {text.count(len(names), 'constituent', 'constituents')} "
        f"({_first(names, ', ', '8', ' and # more')})"
        f"{' and the mean of their file' if has_mean else ''}, every {step_min:g} min, within "
        f"{text.rounded_up(error_m_s, 2):g} m/s in between; wind and rivers are not in them"
    ),
    "tide-too-low": _tide_too_low,
    "water-shut-for-hours": _water_shut_for_hours,
    "departure-chosen": lambda choice: " ".join(departure_text(choice)).removesuffix("."),
    "room-kept": lambda turns_m, offing_m: (
        f"hard-over turns beside the best route need a padding of up to {math.ceil(turns_m):,} m, "
        f"and the offing is {offing_m:,.0f} m: the "
        f"{'offing' if turns_m <= offing_m else 'wider of them'} decides how close it comes"
        if turns_m
        else "no land or other no-go area lies beside the best route: neither hard-over turns nor "
        f"the offing of {offing_m:,.0f} m decide where it runs"
    ),
    "region-chosen": _region_chosen,
    "route-near-edge": lambda ends: f"the best route comes near the region's edge: {_ends(ends)}",
    "replanned": lambda found: " ".join(replanned_text(found)).removesuffix("."),
    "speeds-chosen": lambda found: trade_off_text(found)[0].removesuffix("."),
    "adrift-kept": _adrift_kept,
    "area-shut": _area_shut,
    "crossing": _crossing,
    "current-filled": lambda first, shares: (
        f"no current is given on {_shares(first, shares)}: it was filled from the water around"
    ),
    "streams-weak": lambda limit, first, shares: (
        f"harmonic constants give less than {limit:.0%} of the currents' variance on "
        f"{_shares(first, shares)}: the streams there are a guess"
    ),
    "depth-uncharted": lambda first, shares: f"no depth is charted for {_shares(first, shares)}",
    "least-water": _least_water,
    "narrow-stretch": _narrow_stretch,
    "place-shut": lambda place, begin, until: f"at {place.text}{_from_until(begin, until, ' on')}",
    "strait-shut": _strait_shut,
    "waits-at-anchor": lambda place, begin, until: (
        f"the vessel lies at anchor at {place.text}{_from_until(begin, until, '')}"
    ),
    "over-limit": lambda name, limit, unit, most, begin, until: (
        f"{name} of up to {text.rounded_up(most, 1)} {unit}, over the limit of {limit:g} {unit}, "
        f"shut{_from_until(begin, until, '')} water beside the way: the routes keep out of it, "
        "early, on time and late"
    ),
}
"""The words of each kind of note."""


def caveats_json(result: RunResult) -> dict[str, list[str]]:
    """Say for JSON what is not known about a run's routes, and what was decided for them."""
    return {"unknown": note_texts(result.unknowns), "decided": note_texts(result.decisions)}


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
        "moments": [
            note_value(case.case.moment(moment.seconds))
            for moment in rejected.text.values_of(Moment)
        ],
        "lengths_m": [water.true_m(length) for length in rejected.text.values_of(Length)],
        "strait": None if rejected.strait is None else _strait(water, rejected.strait),
    }


def _strait(water: Water, strait: Strait) -> dict[str, object]:
    """Return the gap that padding fills: its shores, width and both paddings, true metres."""
    scale, shores = water.projection.scale, water.shores(strait.gap)
    return {
        "banks": [
            note_value(water.place(bank)) for bank in (strait.gap if shores is None else shores)
        ],
        "width_m": water.width_m(strait.gap),
        "padding_left_m": strait.padding_left * scale,
        "padding_right_m": strait.padding_right * scale,
    }
