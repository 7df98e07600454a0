"""QGIS styles of the chart's layers: land, depths, hazards and what is no-go."""

from pipeline.formats.figures.palette import COLOURS
from pipeline.formats.gis.qgis.symbols import Rule, Style, colour, fill

# Least depth of an area, m at chart datum, from one limit and below another -> its tint.
_DEPTH_TINTS = (
    (None, 0.0, "#b7ccb0"),
    (0.0, 2.0, "#9dc3e0"),
    (2.0, 5.0, "#b4d3ea"),
    (5.0, 10.0, "#cbe2f1"),
    (10.0, 20.0, "#deedf6"),
    (20.0, None, "#f1f8fc"),
)
_DEPTH_UNKNOWN = "#d5d5d5"


def coast_style() -> Style:
    """Draw land brown, as the report does."""
    land = fill(colour(COLOURS["land"]), colour(COLOURS["coast"]), 0.2)
    return Style("fill", [Rule("Land", "", [land])])


def no_go_style() -> Style:
    """Draw what is no-go beside the land in a lighter brown."""
    zone = fill(colour(COLOURS["nogo"]), colour(COLOURS["coast"]), 0.1, dotted=True)
    return Style("fill", [Rule("Hard no-go zone", "", [zone])])


def hazards_style() -> Style:
    """Draw hazards so that they are seen on a map of the whole."""
    zone = fill(colour(COLOURS["hazard"], 0.5), colour(COLOURS["hazard"]), 0.3)
    return Style("fill", [Rule("Hazards", "", [zone])])


def chart_areas_style() -> Style:
    """Fill what is no-go; outline what may be entered."""
    faint = {kind: colour(COLOURS[kind], 0.06) for kind in ("restricted", "traffic", "shut")}
    symbols = {
        "shoal": ("Too shallow", fill(colour(COLOURS["shoal"]))),
        "uncharted": ("Uncharted", fill(colour(COLOURS["grid"]))),
        "restricted": ("Restricted", fill(faint["restricted"], colour(COLOURS["restricted"]), 0.3)),
        "traffic": ("Traffic scheme", fill(faint["traffic"], colour(COLOURS["traffic"]), 0.3)),
        "shut": ("Shut area", fill(faint["shut"], colour(COLOURS["shut"]), 0.5)),
    }
    rules = [Rule(text, f"\"kind\" = '{kind}'", [area]) for kind, (text, area) in symbols.items()]
    return Style("fill", rules)


def depth_areas_style() -> Style:
    """Tint water by its least depth: the deeper, the lighter, as on paper charts."""
    rules = [
        Rule(
            _depth_text(least, below),
            " AND ".join(
                f'"depth_min_m" {sign} {limit:g}'
                for sign, limit in ((">=", least), ("<", below))
                if limit is not None
            ),
            [fill(colour(tint))],
        )
        for least, below, tint in _DEPTH_TINTS
    ]
    unknown = Rule("Depth not charted", '"depth_min_m" IS NULL', [fill(colour(_DEPTH_UNKNOWN))])
    return Style("fill", [*rules, unknown])


def _depth_text(least: float | None, below: float | None) -> str:
    """Legend of a range of depths."""
    if least is None:
        return "Dries"
    return f"{least:g} m or more" if below is None else f"{least:g} to {below:g} m"
