"""Arguments and options of the commands, as annotated types."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer


def _known_names(section: Literal["scenarios", "vessels"]) -> Callable[[str], list[str]]:
    """Return a function that completes names of a catalogue section in a shell."""

    def completed(incomplete: str) -> list[str]:
        from pipeline.scenario import catalogue

        return [name for name in catalogue.names(section) if name.startswith(incomplete)]

    return completed


# Groups of options in the help of `renew go`.
_vessel, _when, _water, _limits, _output = (
    partial(typer.Option, rich_help_panel=group)
    for group in ("Vessel", "When", "Water", "Limits", "Output")
)

# --- of several commands ---

Scenario = Annotated[
    str,
    typer.Argument(
        help="A name in the catalogue (`renew list`) or the path of a TOML file.",
        autocompletion=_known_names("scenarios"),
    ),
]
Quiet = Annotated[
    bool,
    _output(
        "--quiet", "-q", help="Print errors only: no progress, no notes, and no table at the end."
    ),
]
Json = Annotated[bool, _output("--json", help="Print one JSON object in place of the table.")]
JsonOnly = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Output = Annotated[
    Path, _output(help="Folder of all results; each scenario has its own folder in it.")
]
Offline = Annotated[bool, _water("--offline", help="Use no source that needs the network.")]
Charts = Annotated[
    Path | None,
    _water(help="A vector file or a folder of S-57 cells, in place of the chosen chart."),
]
Currents = Annotated[
    list[str] | None,
    _water(
        help="A NetCDF, GRIB or Zarr file of currents, in place of the chosen ones; may be "
        "repeated for files that belong together, or given as a quoted pattern: 'daily/*.nc'. Or a "
        "source of the catalogue; 'still' plans without currents."
    ),
]
ExplainGap = Annotated[
    bool,
    _output(
        "--explain-gap",
        help="Report the parts of the optimality gap; this may take as long as planning.",
    ),
]
Strict = Annotated[
    bool,
    _water(
        "--strict",
        help="Plan nothing and exit with code 1 if a season's first choice of currents can't be "
        "used.",
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
]

# --- of `renew replan` ---

Results = Annotated[
    Path,
    typer.Argument(metavar="RESULTS", help="Folder of a finished run, such as outputs/NAME."),
]
Departed = Annotated[
    str,
    typer.Option(
        metavar="TIME",
        help="When the vessel left, as 2026-11-22T06:00Z, if the plan has no departure.",
    ),
]
OneSeason = Annotated[str, typer.Option(help="The season that is sailed, if several were planned.")]

# --- of `renew go` ---

Positions = Annotated[
    list[str],
    typer.Argument(
        metavar="START GOAL",
        help="Two positions: '120.30,12.80' (longitude first), '12.80N 120.30E', "
        "'12°48'N 120°18'E'.",
    ),
]
Vessel = Annotated[
    str,
    _vessel(
        help="A vessel of the catalogue, or the path of a TOML file.",
        autocompletion=_known_names("vessels"),
    ),
]
Speed = Annotated[
    str,
    _vessel(
        help="Speed through water, such as 12kn or 6m/s, in place of --vessel. Or a range, "
        "such as 4kn..9kn, also with --vessel: the planner then chooses a speed for each leg, "
        "for least fuel between --depart and --arrive-by."
    ),
]
Length = Annotated[str, _vessel(help="Length of the vessel, as 90m, 300ft.")]
TurningCircle = Annotated[
    str, _vessel(help="Diameter of the turning circle, helm hard over, as 400m.")
]
Draught = Annotated[str, _vessel(help="Draught, as 4m; charts with depths need it.")]
Months = Annotated[
    list[str] | None,
    _when(help="Month of the voyage, as 2024-07; may be repeated: each is a season."),
]
Depart = Annotated[
    str,
    _when(
        help="Departure with its time zone, as 2026-11-22T06:00Z, in place of --month. The "
        "currents then change during the voyage, with the time steps of --currents or with "
        "the service's hourly ones."
    ),
]
Until = Annotated[
    str, _when(help="Latest departure: the best one from --depart until then is chosen.")
]
ArriveBy = Annotated[
    str,
    _when(
        help="Latest arrival: the vessel leaves as late as possible, but not before --depart; "
        "with a range of --speed it leaves at --depart."
    ),
]
Via = Annotated[
    list[str] | None,
    _limits(
        metavar="POSITION",
        help="Point that the route must pass, written like START; may be repeated, in the "
        "order of passing. 'POSITION wait 6h' is an anchorage, where the vessel may wait for "
        "water or current.",
    ),
]
Avoid = Annotated[
    list[Path] | None,
    _limits(
        metavar="FILE",
        help="GeoJSON or other vector file of areas that no route may enter; may be repeated.",
    ),
]
Havens = Annotated[
    Path | None,
    _limits(
        metavar="FILE",
        help="GeoJSON or other file of points, or CSV with name, lon and lat: from where along the "
        "route is one of them reached --within a time, or with the --endurance that is left?",
    ),
]
Within = Annotated[str, _limits(help="Longest time to a haven, as 6h; needs --havens.")]
Endurance = Annotated[
    str,
    _limits(help="Time under way for which there is fuel at departure, as 2d; needs --havens."),
]
Tide = Annotated[
    list[str] | None,
    _limits(
        metavar="STATION",
        help="Tide station of the catalogue, or a file of harmonic constants; may be repeated. "
        "Needs --draught, --depart and a chart with depths.",
    ),
]
Members = Annotated[
    str,
    _water(
        metavar="KIND",
        help="Plan in currents that may each come true: 'files', if each file of --currents is "
        "one, a dimension of them, such as 'realization', or 0.2m/s for the currents with random "
        "eddies of that speed (rms).",
    ),
]
Datum = Annotated[
    str,
    _water(
        help="Chart datum of the depths, as the tide's station names it, such as MLLW, where the "
        "chart does not state it; --tide needs it with --depths."
    ),
]
Clearance = Annotated[
    str, _limits(help="Least distance from no-go areas, true metres; chosen if left out.")
]
Name = Annotated[str, _output(help="Name of the folder of results.")]
Depths = Annotated[
    Path | None,
    _water(help="A GEBCO or EMODnet grid (NetCDF): too shallow water is no-go; needs --draught."),
]
