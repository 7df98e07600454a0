"""The words of notes and of rejected classes, and how a note's values are put into them.

A note's words are a sentence for `str.format`, or a function of its values where the sentence
depends on them. Besides the usual formats there are `{x:distance}` and `{x:hours}` for quantities,
`{n:route|routes}` for a count with its noun, `{list:, }` for a list with its separator, and
`{list:, /3/ and # more}` for a list of which only three entries are named.
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
    "box": text.box,
    "distance": text.distance,
    "at most": lambda value: f"{text.rounded_up(value, 2):g}",
    "at most hours": text.at_most_hours,
    "clearance": text.clearance,
    "hours": text.hours,
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
        f"({speed_m_s:g} m/s); where it is strongest, up to {text.rounded_up(most_m_s, 2):g} m/s "
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
        f"land{but} (planner.adrift, --adrift)"
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
        f"{begin.text} to {end.text}: a turn to {side} would meet {no_go}. "
        f"{wide} a turn takes {text.distance(needed_m)} to a side; at this speed "
        f"{fits}: slow down, or take a tug"
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
    # The chart.
    "accuracy-assumed": "{source}: its coast is assumed to be accurate to {accuracy_m:g} m, as no "
    "accuracy is given (accuracy_m)",
    "joined-at-180": "{source}: {count:part has|parts have} an edge longer than 180 degrees of "
    "longitude, and {count:was|were} taken to cross 180 degrees there",
    "areas-repaired": "{source}: {count:area was invalid and was|areas were invalid and were} "
    "repaired (rings that cross or touch themselves)",
    "chart-not-near": "{source} has nothing near the region",
    "chart-no-go": "no-go: all water except where the chart gives a depth of "
    "{safety_depth_m:g} m or more (draught plus under-keel clearance, at chart datum, without "
    "tide)",
    "depths-lacking": "{source} has no depths for {share:.1%} of the region (some of it may be "
    "land): routes may cross the water there, whatever its depth",
    "depths-no-go": "no-go: all water that is less than {safety_depth_m:g} m deep in {source} "
    "(draught plus under-keel clearance, at the grid's own datum, without tide), and one cell of "
    "{cell_m:.0f} m around it; shoals smaller than a cell are not in such a grid",
    "entry-prohibited": "routes may cross areas where entry is prohibited or to be avoided: "
    "{areas:, }",
    "features-without-geometry": "{source}: {count:feature has|features have} no geometry, and so "
    "no land",
    "gdal-warning": "{source}: GDAL warns: {warning}",
    "land-not-cached": "the world's land could not be kept in the user's cache ({problem}): it is "
    "unpacked again for each region, which takes some seconds; set XDG_CACHE_HOME to a writable "
    "folder",
    "margin-narrowed": "the margin of {margin_m:g} m would close every passage between start and "
    "goal: it was reduced along the way; the narrowest place, at {place}, is "
    "{width_m:clearance} wide",
    "margin-raised": "chart.margin_m is {margin_m:g} m, but the coast may be off by "
    "{accuracy_m:g} m: a margin of {accuracy_m:g} m was used",
    "no-cell": "no S-57 cell covers {share:.1%} of the region: it is no-go",
    "poor-survey": "{share:.0%} of the water is charted from poor or unassessed surveys (zones of "
    "confidence C, D, U): objects may lie 500 m or more off their charted place",
    # The currents.
    "climatology-stands-in": "planned on {source}: {valid} stands in for {asked}",
    "current-at-depth": "the currents are from {depth_m:g} m depth",
    "current-changes": "the current changes on the way: it has {steps} time steps",
    "current-doubtful": "check {source}: {warning}",
    "current-geostrophic": "the currents are geostrophic: without tide and wind drift",
    "current-lacking": _current_lacking,
    "current-on-table": _current_on_table,
    "current-gaps-filled": "the current had gaps at some times in {share:.1%} of its cells: they "
    "were filled from the times before and after, up to {hours:g} hours away; {lost:.1%} have a "
    "longer gap, and count as without data",
    "current-means-lack": "the current's mean lacks some of its times in up to {share:.1%} of its "
    "cells: it is the mean of those that are there, at least half",
    "current-over-depth": "the currents are means over depth, not of the surface",
    "current-stands-in": "planned on {source}, valid {valid}",
    "current-used": lambda source, valid: (
        f"planned on {source}{f', valid {valid}' if valid else ''}"
    ),
    "current-unknown": lambda left_out: (
        f"{'no current was used' if left_out else 'no current is given on the best route'}: real "
        "fuel and times may differ, and no choice of a way is proven"
    ),
    "forecasts-overlap": "{count:time step gives|time steps give} way to a later forecast, "
    "the latest of {reference:%Y-%m-%d %H:%M} UTC",
    "level-assumed": "the only level, {level} = {value:g}, is taken for the surface",
    "level-by-name": "of {level} the index {at} is taken for the surface, by its name",
    "member-left-out": "a member of the current was left out: {reason}",
    "current-without-tide": "the currents are without tide",
    "constants-old": "the harmonic constants come from currents of {begin:%Y-%m-%d} to "
    "{end:%Y-%m-%d}, {years:.0f} years from the departure: channels and banks may have moved",
    "pair-taken": "the current is {u} and {v} of the file, {why:; }",
    "source-passed-over": "{reason}",
    "steps-are-means": "its time steps are means of a {step}, without the tide",
    "steps-read": "the file's time steps are read as {how}",
    "steps-sparse": "{count:time step stands|time steps stand} for all of {asked: to }: "
    "{steps: to }",
    "still-water": "planned without currents, in still water",
    "streams-on-residual": "the streams run on {source}, valid {valid}",
    "tidal-streams": lambda names, step_min, error_m_s, has_mean: (
        f"tidal streams are the sum of {text.count(len(names), 'constituent', 'constituents')} "
        f"({_first(names, ', ', '8', ' and # more')})"
        f"{' and the mean of their file' if has_mean else ''}, every {step_min:g} min, within "
        f"{text.rounded_up(error_m_s, 2):g} m/s in between; wind and rivers are not in them"
    ),
    "tide-too-low": _tide_too_low,
    "tide-unknown": "water as at {place} is deep enough for some hours only, and no station counts "
    "there: the nearest is more than 10 km away by water, and no official levels reach so far. "
    "Routes keep off it; add a station, or give one a zone in a TOML file",
    "time-assumed": "the file gives no time: it is assumed to hold for the requested time",
    "unit-assumed": "{variable} has no unit: {assumed} is assumed",
    "unit-converted": "{variable} is in {unit}: converted to {to}",
    "water-shut": "in {share:.1%} of the water the current is as fast as the vessel "
    "({speed_m_s:g} m/s) or faster, up to {most_m_s:at most} m/s at {place}: no route leads there",
    "water-shut-for-hours": _water_shut_for_hours,
    "zeros-are-land": "zeros in the file are treated as land",
    # What was chosen.
    "currents-end": "in the {sides: and } the region ends where the data of {source} end",
    "departure-chosen": lambda choice: " ".join(departure_text(choice)).removesuffix("."),
    "departure-in-mean": "the departure was chosen in the mean of the members' currents, and at "
    "that departure the side in all of them",
    "departures-asked": "{count} departures are planned to choose from",
    "departures-planned": "{count} of {asked} departures are planned",
    "departures-refined": "{count} departures are planned; another one may still save up to "
    "{unproven_s:at most hours}",
    "offing-chosen": "routes keep an offing of {offing_m:,.0f} m beyond the chart's margin, chosen "
    "for this vessel and chart, and in narrower passages {narrow_share:.0%} of the half-width; "
    "planner.clearance (--clearance) sets another, and 0 means none",
    "offing-yields": "the best route keeps less than the offing of {offing_m:,.0f} m for "
    "{length_m:distance} in narrows, or beside start or goal: at least {least_m:clearance} beyond "
    "the chart's margin at {place}",
    "room-kept": lambda turns_m, offing_m: (
        f"hard-over turns beside the best route need a padding of up to {math.ceil(turns_m):,} m, "
        f"and the offing is {offing_m:,.0f} m: the "
        f"{'offing' if turns_m <= offing_m else 'wider of them'} decides how close it comes"
        if turns_m
        else "no land or other no-go area lies beside the best route: neither hard-over turns nor "
        f"the offing of {offing_m:,.0f} m decide where it runs"
    ),
    "region-chosen": _region_chosen,
    "region-opened": "region widened to {bounds:box}, because no way joins start and goal in a "
    "smaller region",
    "region-widened": "region widened to {bounds:box}, because the best route came near its "
    "{near: and } edge",
    "route-near-edge": lambda ends: f"the best route comes near the region's edge: {_ends(ends)}",
    "how-sure": "{said}",
    "as-read": "{said}",
    "replanned": lambda found: " ".join(replanned_text(found)).removesuffix("."),
    "stop-moved": "{stop} lies on land: it was moved {moved_m:distance} to {place}, the nearest "
    "water that joins start and goal; planner.snap (--snap) sets how far, and 0 means not at all",
    "speeds-chosen": lambda found: trade_off_text(found)[0].removesuffix("."),
    "levels-below-tide": "within 10 km of {station} the official levels are for {share:.0%} of the "
    "water at some hour more than {surge_m:g} m lower than its tide, by up to {most_m:.2f} m: the "
    "levels count where they reach, and beyond them that tide may be as much too high",
    "levels-relied-on": lambda source, begin, until: (
        f"the height of the water is that of {source} at each place and hour, from "
        f"{text.moment_text(begin)} until {text.moment_text(until)}; outside these hours the lowest"
        " of its levels counts"
    ),
    "tide-relied-on": "depths and the tide of {stations: and } are counted from {datum}; the "
    "vessel relies on the least height predicted within {lag_min:g} min, less {surge_m:g} m; the "
    "error of soundings is not taken off",
    # The routes.
    "coverage": lambda covered, uncovered, not_settled: (
        f"from {text.share(covered)} of the best route, by time, a planned way leads to a haven "
        f"within the limits; from {text.share(uncovered)} nobody gets to one in time; "
        f"{text.share(not_settled)} is not settled"
    ),
    "energy-short": lambda rank, needs, has, unit: (
        f"route {rank} needs {text.number(needs)} {unit}, and battery or tank give "
        f"{text.number(has)} {unit} over the reserve: the vessel doesn't get there"
    ),
    "haven-left-out": lambda haven, place, reason: f"haven {haven!r} at {place.text} {reason}",
    "adrift": lambda least_s, place, soon, ashore, by_wind: (
        f"without thrust the current {'and the wind carry' if by_wind else 'carries'} the vessel "
        f"ashore in {text.duration(least_s)}, from {place.text}; within 6 h from "
        f"{text.percent(soon)} of the best route, within 72 h from {text.percent(ashore)}"
    ),
    "adrift-kept": _adrift_kept,
    "worst-met": lambda name, unit, most, place, at, left: (
        f"{name} of up to {most:.1f} {unit} on the best route, at {place.text}, "
        f"{text.moment_text(at)}: {left:.1f} {unit} below the limit"
    ),
    "area-shut": _area_shut,
    "against-lane": "route {rank} sails against the {lane} for {length_m:distance}, at {place}: "
    "vessels under 20 m need not keep lanes, unless planner.lanes = true, and others do where "
    "there is a way that does",
    "lane-kept": "a way of less fuel sails against the {lane}: the routes keep out of it "
    "(COLREGS rule 10; planner.lanes = false asks for no lane)",
    "canal-left-out": "the {canal} joins start and goal, and no route leads through it: canals are "
    "land in this chart, or too narrow to turn in. Between its ends at {begin} and {end} the way "
    "through it has about {way_m:distance}",
    "classes-shut-for-hours": "no route was found where the current shuts water on the way for a "
    "while: {ways:; /3/, and of # more}. At another departure the water may be open",
    "crossing": _crossing,
    "current-filled": lambda first, shares: (
        f"no current is given on {_shares(first, shares)}: it was filled from the water around"
    ),
    "streams-weak": lambda limit, first, shares: (
        f"harmonic constants give less than {limit:.0%} of the currents' variance on "
        f"{_shares(first, shares)}: the streams there are a guess"
    ),
    "depth-uncharted": lambda first, shares: f"no depth is charted for {_shares(first, shares)}",
    "no-depths": "no depths in this chart: the draught was not used, and shoals are not avoided",
    "least-water": _least_water,
    "narrow-stretch": _narrow_stretch,
    "not-safe-everywhere": "not safe everywhere: {collisions:,} of {turns:,} hard-over turns along "
    "route {rank} met {no_go}, the first one from {place}; it was planned with padding = "
    '{padding!r}, and only "adaptive" and "triangle" are verified',
    "place-shut": lambda place, begin, until: f"at {place.text}{_from_until(begin, until, ' on')}",
    "routes-shut-for-hours": "the current shuts water for a while on the way of "
    "{ways:; /3/, and of # more}. The routes are the best without waiting",
    "second-shoreline": "a second, independent shoreline (GSHHG, Wessel and Smith 1996) has land "
    "where routes cross water of this chart; check these places on an official chart: "
    "{crossings:; /8/; and # shorter}",
    "strait-unresolved": "the strait at {place} is {width_m:distance} wide, and a cell of the "
    "current is {cell_m:distance} wide: the tide in the strait is not resolved, and may run harder "
    "and turn at another time than planned",
    "strait-shut": _strait_shut,
    "straits-shut": "{count:strait is|straits are} shut by margin or padding; a way would be "
    "{saves:.0%} shorter in time than the best way round, both without padding, through "
    "{straits: and through /3/ and # more}",
    "unlisted-land": "OpenStreetMap has land where routes cross water of this chart; check these "
    "places on an official chart: {crossings:; /8/; and # shorter}",
    "waits-at-anchor": lambda place, begin, until: (
        f"the vessel lies at anchor at {place.text}{_from_until(begin, until, '')}"
    ),
    "waits-for-water": lambda place, begin, until, fuel, anchors: (
        f"the vessel waits {'at anchor ' * anchors}at {place.text}{_from_until(begin, until, '')}, "
        "until water ahead opens"
        + (f": staying there takes {text.number(fuel)} of fuel" if fuel else "")
    ),
    "limits-unchecked": "{vessel} has limits of waves or wind, and no files were given to hold "
    "them against (--waves, --wind)",
    "over-limit": lambda name, limit, unit, most, begin, until: (
        f"{name} of up to {text.rounded_up(most, 1)} {unit}, over the limit of {limit:g} {unit}, "
        f"shut{_from_until(begin, until, '')} water beside the way: the routes keep out of it, "
        "early, on time and late"
    ),
    "way-shut": "{way} {places:, /3/ and at # more places}",
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
