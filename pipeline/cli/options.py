"""Arguments and options of the commands, as annotated types."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal

import typer


def _known_names(section: Literal["scenarios", "vessels"]) -> Callable[[str], list[str]]:
    """Return a function that completes names of a catalogue section in a shell."""

    def completed(incomplete: str) -> list[str]:
        from pipeline.scenario import catalogue

        return [name for name in catalogue.names(section) if name.startswith(incomplete)]

    return completed


# The groups of options in the help of `renew go`.
_VESSEL, _WHEN, _WATER, _LIMITS, _OUTPUT = "Vessel", "When", "Water", "Limits", "Output"

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
    typer.Option(
        "--quiet",
        "-q",
        help="Print errors only: no progress, no notes, and no table at the end.",
        rich_help_panel=_OUTPUT,
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="Print one JSON object in place of the table.", rich_help_panel=_OUTPUT
    ),
]
JsonOnly = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Output = Annotated[
    Path,
    typer.Option(
        help="Folder of all results; each scenario has its own folder in it.",
        rich_help_panel=_OUTPUT,
    ),
]
Offline = Annotated[
    bool,
    typer.Option("--offline", help="Use no source that needs the network.", rich_help_panel=_WATER),
]
Charts = Annotated[
    Path | None,
    typer.Option(
        help="A vector file or a folder of S-57 cells, in place of the chosen chart.",
        rich_help_panel=_WATER,
    ),
]
Currents = Annotated[
    list[str] | None,
    typer.Option(
        help="A NetCDF file or Zarr store of currents, in place of the chosen ones; may be "
        "repeated for files that belong together, or given as a quoted pattern: 'daily/*.nc'. Or a "
        "source of the catalogue; 'still' plans without currents.",
        rich_help_panel=_WATER,
    ),
]
ExplainGap = Annotated[
    bool,
    typer.Option(
        "--explain-gap",
        help="Report the parts of the optimality gap; this may take as long as planning.",
        rich_help_panel=_OUTPUT,
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="Plan nothing and exit with code 1 if a season's first choice of currents can't be "
        "used.",
        rich_help_panel=_WATER,
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
]

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
    typer.Option(
        help="A vessel of the catalogue, or the path of a TOML file.",
        autocompletion=_known_names("vessels"),
        rich_help_panel=_VESSEL,
    ),
]
Speed = Annotated[
    str,
    typer.Option(
        help="Speed through water, such as 12kn or 6m/s, in place of --vessel. Or a range, "
        "such as 4kn..9kn, also with --vessel: the planner then chooses a speed for each leg, "
        "for least fuel between --depart and --arrive-by.",
        rich_help_panel=_VESSEL,
    ),
]
Length = Annotated[
    str, typer.Option(help="Length of the vessel, as 90m, 300ft.", rich_help_panel=_VESSEL)
]
TurningCircle = Annotated[
    str,
    typer.Option(
        help="Diameter of the turning circle, helm hard over, as 400m.", rich_help_panel=_VESSEL
    ),
]
Draught = Annotated[
    str, typer.Option(help="Draught, as 4m; charts with depths need it.", rich_help_panel=_VESSEL)
]
Months = Annotated[
    list[str] | None,
    typer.Option(
        help="Month of the voyage, as 2024-07; may be repeated: each is a season.",
        rich_help_panel=_WHEN,
    ),
]
Depart = Annotated[
    str,
    typer.Option(
        help="Departure with its time zone, as 2026-11-22T06:00Z, in place of --month. The "
        "currents then change during the voyage, with the time steps of --currents or with "
        "the service's hourly ones.",
        rich_help_panel=_WHEN,
    ),
]
Until = Annotated[
    str,
    typer.Option(
        help="Latest departure: the best one from --depart until then is chosen.",
        rich_help_panel=_WHEN,
    ),
]
ArriveBy = Annotated[
    str,
    typer.Option(
        help="Latest arrival: the vessel leaves as late as possible, but not before --depart; "
        "with a range of --speed it leaves at --depart.",
        rich_help_panel=_WHEN,
    ),
]
Via = Annotated[
    list[str] | None,
    typer.Option(
        metavar="POSITION",
        help="Point that the route must pass, written like START; may be repeated, in the "
        "order of passing.",
        rich_help_panel=_LIMITS,
    ),
]
Avoid = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="GeoJSON or other vector file of areas that no route may enter; may be repeated.",
        rich_help_panel=_LIMITS,
    ),
]
Tide = Annotated[
    list[str] | None,
    typer.Option(
        metavar="STATION",
        help="Tide station of the catalogue, or a file of harmonic constants; may be repeated. "
        "Needs --draught, --depart and a chart with depths.",
        rich_help_panel=_LIMITS,
    ),
]
Clearance = Annotated[
    str,
    typer.Option(
        help="Least distance from no-go areas, true metres; chosen if left out.",
        rich_help_panel=_LIMITS,
    ),
]
Name = Annotated[str, typer.Option(help="Name of the folder of results.", rich_help_panel=_OUTPUT)]
Depths = Annotated[
    Path | None,
    typer.Option(
        help="A GEBCO or EMODnet grid (NetCDF): too shallow water is no-go; needs --draught.",
        rich_help_panel=_WATER,
    ),
]
