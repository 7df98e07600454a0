"""QGIS styles of the layers, the same for a layer by itself and inside the project."""

from collections.abc import Callable, Iterable
from typing import TypeAlias

from pipeline.findings.columns import COLUMNS
from pipeline.formats.figures.map_marks import speed_labels
from pipeline.formats.gis.qgis import (
    CaseView,
    Label,
    Rule,
    Style,
    SymbolLayer,
    View,
    arrow,
    colour,
    fill,
    line,
    literal,
    marker,
    one_line,
    rendered,
)
from pipeline.formats.palette import COLOURS, STATES

_Symbol: TypeAlias = Callable[[CaseView], SymbolLayer]

# Tints by least depth of an area, m at chart datum: from the first limit to below the second.
_DEPTH_TINTS = (
    (None, 0.0, "#b7ccb0"),
    (0.0, 2.0, "#9dc3e0"),
    (2.0, 5.0, "#b4d3ea"),
    (5.0, 10.0, "#cbe2f1"),
    (10.0, 20.0, "#deedf6"),
    (20.0, None, "#f1f8fc"),
)
_DEPTH_UNKNOWN = "#d5d5d5"

# Colour of a turn that met land; no other feature has it.
_COLLISION_COLOUR = "#d50000"
# Around symbols and text, so that they stand out from what is below.
_HALO = colour(COLOURS["halo"])
# Of text.
_INK = colour(COLOURS["ink"])
_SOFT_OPACITY = 0.38
# Condition of the best route's features.
_BEST = '"rank" = 1'
# Condition of the features of the other classes' routes.
_OTHER = '"rank" > 1'
_AT_GOAL = '"course_deg" IS NULL'
# Minimum and maximum length of the strongest arrows on paper, mm; closer points are thinned out.
_ARROW_MM = (5.5, 12.0)
# Length of an arrow of speed 0, as a share of the strongest's.
_SHORTEST = 0.4
# Maximum number of characters of a case's title along its route.
_MAX_LABEL_LENGTH = 32


# Land is brown, as in the report; the no-go zone around it is lighter. The chart's no-go areas are
# filled; areas that may be entered are outlined.
_LAND = fill(colour(COLOURS["land"]), colour(COLOURS["coast"]), 0.2)
_REGION = line(colour(COLOURS["frame"]), 0.25)
_NO_GO = fill(colour(COLOURS["nogo"]), colour(COLOURS["coast"]), 0.1, dotted=True)
_TIDAL = fill(colour(COLOURS["shoal"], 0.45), colour(COLOURS["shoal"]), 0.2, dotted=True)
_HAZARD = fill(colour(COLOURS["hazard"], 0.5), colour(COLOURS["hazard"]), 0.3)
_CHART_AREAS = {
    "shoal": ("Too shallow", fill(colour(COLOURS["shoal"]))),
    "uncharted": ("Uncharted", fill(colour(COLOURS["grid"]))),
    **{
        kind: (text, fill(colour(COLOURS[kind], 0.06), colour(COLOURS[kind]), width))
        for kind, text, width in (
            ("restricted", "Restricted", 0.3),
            ("traffic", "Traffic scheme", 0.3),
            ("shut", "Shut area", 0.5),
        )
    },
}


def _depth_areas() -> Style:
    """Tint water by its least depth: deeper water is lighter, as on paper charts."""
    rules = []
    for least, below, tint in _DEPTH_TINTS:
        limits = [f'"depth_min_m" >= {least:g}'] if least is not None else []
        limits += [f'"depth_min_m" < {below:g}'] if below is not None else []
        text = f"{least:g} m or more" if below is None else f"{least or 0:g} to {below:g} m"
        text = "Dries" if least is None else text
        rules.append(Rule(text, " AND ".join(limits), [fill(colour(tint))]))
    unknown = Rule("Depth not charted", '"depth_min_m" IS NULL', [fill(colour(_DEPTH_UNKNOWN))])
    return Style("fill", [*rules, unknown])


def style(layer: str, view: View) -> Style:
    """Style a layer by its name."""
    return _STYLES[layer](view)


def qml(layer: str, view: View, columns: Iterable[str]) -> str:
    """Write a layer's style as a QML document."""
    return rendered("layer.qml.jinja", style=style(layer, view), columns=columns, fields=COLUMNS)


def _routes(view: View) -> Style:
    """Draw the best route bold, all others thin, in the case's colour.

    The leading case's best route is wider, on a halo, and lies below the other cases', so that
    both are visible where they coincide.
    """

    def rules(case: CaseView) -> list[Rule]:
        others = line(colour(case.colour, 0.6), 0.32)
        best = [line(colour(case.colour), 0.7, level=3)]
        if case.leads:
            best = [line(_HALO, 1.9, level=1), line(colour(case.colour), 1.2, level=2)]
        return [
            Rule("Best route", _BEST, best),
            Rule("Other classes", _OTHER, [others], on=case.leads),
        ]

    labels = [
        Label(
            literal(one_line(case.title, _MAX_LABEL_LENGTH)),
            f"{_BEST} AND {_of(case)}",
            colour(case.colour),
            9,
            along_line=True,
        )
        for case in view.cases
    ]
    return Style("line", _by_case(view, rules, all_on=True), labels, levels=True)


def _passage(view: View) -> Style:
    """Mark waypoints, start and goal of the best routes; at larger scales, with courses."""

    def rules(case: CaseView) -> list[Rule]:
        own = colour(case.colour)
        between = f'{_BEST} AND "sequence" > 1 AND NOT ({_AT_GOAL})'
        small = marker("circle", colour(case.colour, 0.6), _HALO, 0.9)
        among = marker("circle", _HALO, own, 1.8, 0.4, level=1)
        start = marker("circle", _HALO, own, 3.4, 0.8, level=2)
        goal = marker("diamond", _HALO, own, 4.0, 0.8, level=2)
        return [
            Rule("Waypoints of the other classes", _OTHER, [small], finer_than=closer),
            Rule("Waypoints", between, [among]),
            Rule("Start", f'{_BEST} AND "sequence" = 1', [start]),
            Rule("Goal", f"{_BEST} AND {_AT_GOAL}", [goal]),
        ]

    closer = view.full_scale / 4
    labels = []
    for case in view.cases:
        if case.leads or len(view.cases) == 1:
            ends = f'{_BEST} AND ("sequence" = 1 OR {_AT_GOAL}) AND {_of(case)}'
            labels.append(Label('"name"', ends, _INK, 10))
    course = f"\"name\" || ': ' || lpad(round(\"course_deg\") % 360, 3, '0') || {literal('°')}"
    labels.append(Label(course, f"{_BEST} AND NOT ({_AT_GOAL})", _INK, 8, finer_than=closer))
    return Style("marker", _by_case(view, rules), labels, levels=True)


def _best_and_others(view: View, best: _Symbol, others: _Symbol) -> list[Rule]:
    """Draw the features of the best routes; those of other classes are switched off at first."""
    return _by_case(
        view,
        lambda case: [
            Rule("Of the best route", _BEST, [best(case)]),
            Rule("Of the other classes", _OTHER, [others(case)], on=False),
        ],
    )


def _legs(view: View) -> Style:
    """Fill the water within the cross-track limits."""

    def water(case: CaseView, edge: float) -> SymbolLayer:
        return fill(colour(case.colour, 0.18), colour(case.colour, 0.7), edge)

    return Style("fill", _best_and_others(view, lambda s: water(s, 0.15), lambda s: water(s, 0.1)))


def _path_points(view: View) -> Style:
    """Dot the points of the planned paths."""

    def dot(case: CaseView, opacity: float, size: float) -> SymbolLayer:
        return marker("circle", colour(case.colour, opacity), _HALO, size)

    rules = _best_and_others(view, lambda s: dot(s, 1.0, 0.9), lambda s: dot(s, 0.5, 0.7))
    return Style("marker", rules)


def _channels(view: View) -> Style:
    """Outline channels; those of rejected classes dotted."""

    def rules(case: CaseView) -> list[Rule]:
        own, faint = colour(case.colour, 0.7), colour(COLOURS["other"], 0.5)
        none = colour(COLOURS["halo"], 0.0)
        return [
            Rule("Of the best route", _BEST, [fill(colour(case.colour, 0.05), own, 0.5)]),
            Rule("Of the other classes", _OTHER, [fill(none, faint, 0.2)], on=False),
            Rule("Rejected", '"rank" = 0', [fill(none, faint, 0.3, dotted=True)], on=False),
        ]

    return Style("fill", _by_case(view, rules))


def _islands() -> Style:
    """Write each island's name or number on it."""
    none = marker("circle", colour(COLOURS["halo"], 0.0), colour(COLOURS["halo"], 0.0), 0.4)
    name = 'if(coalesce("name", \'\') = \'\', to_string("number"), "name")'
    labels = [Label(name, "", _INK, 9)]
    return Style("marker", [Rule("Islands", "", [none])], labels)


def _soft_no_go(view: View) -> Style:
    """Draw zones grey; the layer as a whole is translucent, so that overlaps don't darken."""
    grey = fill(colour(COLOURS["soft"]))
    rules = _best_and_others(view, lambda _: grey, lambda _: grey)
    return Style("fill", rules, opacity=_SOFT_OPACITY)


def _currents(view: View) -> Style:
    """Draw arrows towards which the current sets: darker and longer if stronger."""
    rotation = '"direction"' + (f" - {view.convergence}" if view.convergence else "")
    limits = view.speed_limits

    def rules(case: CaseView) -> list[Rule]:
        drawn = []
        for index, (label, lower) in enumerate(
            zip(speed_labels(limits), (0.0, *limits[:-1]), strict=True)
        ):
            share = _SHORTEST + (1 - _SHORTEST) * (index + 1) / len(limits)
            upto = f' AND "speed" <= {limits[index]:g}' if index + 1 < len(limits) else ""
            condition = f'"speed" > {lower:g}{upto}{_thinned(case, view.full_scale)}'
            on_paper = (share * _ARROW_MM[0], share * _ARROW_MM[1])
            tint = colour(COLOURS[f"speed{index}"])
            symbol = arrow(tint, share * case.spacing_m, rotation, on_paper)
            drawn.append(Rule(f"{label} m/s", condition, [symbol]))
        return drawn

    return Style("marker", _by_case(view, rules))


def _thinned(case: CaseView, full_scale: float) -> str:
    """Return a condition that omits points that would be too close on a map of the whole chart."""
    min_spacing_m = _ARROW_MM[0] / 1000 * full_scale
    every = round(min_spacing_m / case.spacing_m + 0.49)
    if case.step_deg is None or every < 2:
        return ""
    (west, south), (east, north) = case.origin, case.step_deg
    roomy_scale = 1000 * case.spacing_m / _ARROW_MM[0]
    return (
        f" AND (@map_scale < {roomy_scale:.0f}"
        f" OR (round((x($geometry) - {west:.10g}) / {east:.10g}) % {every} = 0"
        f" AND round((y($geometry) - {south:.10g}) / {north:.10g}) % {every} = 0))"
    )


def _contingency(view: View) -> Style:
    """Mark turns that met a no-go area with a cross, all others with a dot."""

    def rules(case: CaseView) -> list[Rule]:
        dot = marker("circle", colour(case.colour, 0.75), _HALO, 0.8)
        faint = marker("circle", colour(case.colour, 0.4), _HALO, 0.6)
        cross = marker("cross2", colour(_COLLISION_COLOUR), colour(_COLLISION_COLOUR), 2.6, 0.7)
        return [
            Rule("Clear", f'{_BEST} AND NOT "collided"', [dot]),
            Rule("Clear, other classes", f'{_OTHER} AND NOT "collided"', [faint], on=False),
            Rule("Met a no-go area", '"collided"', [cross]),
        ]

    return Style("marker", _by_case(view, rules))


def _shore_crossings(view: View) -> Style:
    """Ring the places where routes cross land of the second shoreline, as in the report."""
    none = colour(COLOURS["halo"], 0.0)
    ring = marker("circle", none, colour(COLOURS["shut"]), 3.6, 0.6)
    faint = marker("circle", none, colour(COLOURS["shut"], 0.6), 3.0, 0.3)
    return Style("marker", _best_and_others(view, lambda _: ring, lambda _: faint))


def _havens(view: View) -> Style:
    """Mark havens with their names; those that are not used are hollow."""

    def rules(_: CaseView) -> list[Rule]:
        own, none = colour(COLOURS["haven"]), colour(COLOURS["halo"], 0.0)
        return [
            Rule("Havens", "\"reason\" = ''", [marker("triangle", own, _HALO, 3.4, 0.4)]),
            Rule("Not used", "\"reason\" <> ''", [marker("triangle", none, own, 3.0, 0.4)]),
        ]

    return Style("marker", _by_case(view, rules), [Label('"name"', "", _INK, 9)])


def _diversions(view: View) -> Style:
    """Draw ways to havens thin."""
    own = line(colour(COLOURS["haven"], 0.8), 0.3)
    return Style("line", _by_case(view, lambda _: [Rule("Ways to havens", "", [own])]))


def _coverage(view: View) -> Style:
    """Mark along the best route what is uncovered or not settled; what is covered, finely."""
    widths = {"covered": 0.4, "not settled": 0.9, "uncovered": 1.1}
    rules = [
        Rule(state.capitalize(), f"\"state\" = '{state}'", [line(colour(STATES[state]), width)])
        for state, width in widths.items()
    ]
    return Style("line", _by_case(view, lambda _: rules))


def _by_case(
    view: View, rules: Callable[[CaseView], list[Rule]], *, all_on: bool = False
) -> list[Rule]:
    """Group the rules of each case under a rule of its own, if there are several cases."""
    if len(view.cases) == 1:
        return rules(view.cases[0])
    return [
        Rule(case.title, _of(case), children=rules(case), on=all_on or case.leads)
        for case in view.cases
    ]


def _of(case: CaseView) -> str:
    """Return the condition that a feature belongs to a case."""
    return f'"season" = {literal(case.name)}'


_STYLES: dict[str, Callable[[View], Style]] = {
    "routes": _routes,
    "passage": _passage,
    "legs": _legs,
    "path_points": _path_points,
    "channels": _channels,
    "islands": lambda _: _islands(),
    "coast": lambda _: Style("fill", [Rule("Land", "", [_LAND])]),
    "region": lambda _: Style("line", [Rule("Edge of the region", "", [_REGION])]),
    "hazards": lambda _: Style("fill", [Rule("Hazards", "", [_HAZARD])]),
    "chart_areas": lambda _: Style(
        "fill",
        [Rule(text, f"\"kind\" = '{kind}'", [area]) for kind, (text, area) in _CHART_AREAS.items()],
    ),
    "no_go": lambda _: Style("fill", [Rule("Hard no-go zone", "", [_NO_GO])]),
    "depth_areas": lambda _: _depth_areas(),
    "tidal_water": lambda _: Style("fill", [Rule("Deep enough for some hours", "", [_TIDAL])]),
    "soft_no_go": _soft_no_go,
    "currents": _currents,
    "contingency": _contingency,
    "shore_crossings": _shore_crossings,
    "havens": _havens,
    "diversions": _diversions,
    "coverage": _coverage,
}
