"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import Section


def _known_names(section: Section) -> Callable[[str], list[str]]:
    """Return a function that completes names of a catalogue section in a shell."""

    def completed(incomplete: str) -> list[str]:
        from pipeline.scenario import catalogue

        return [name for name in catalogue.names(section) if name.startswith(incomplete)]

    return completed


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="A name in the catalogue (`renew list`) or the path of a TOML file.",
        autocompletion=_known_names("scenarios"),
    ),
]
VesselOption = Annotated[
    str,
    typer.Option(
        help="A vessel of the catalogue, or the path of a TOML file.",
        autocompletion=_known_names("vessels"),
    ),
]
QuietOption = Annotated[
    bool,
    typer.Option(
        "--quiet", "-q", help="Print errors only: no progress, no notes, and no table at the end."
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object in place of the table.")
]

OutputOption = Annotated[
    Path, typer.Option(help="Folder of all results; each scenario has its own folder in it.")
]
OfflineOption = Annotated[
    bool, typer.Option("--offline", help="Use no source that needs the network.")
]
ChartsOption = Annotated[
    Path | None,
    typer.Option(help="A vector file or a folder of S-57 cells, in place of the chosen chart."),
]
CurrentsOption = Annotated[
    list[str] | None,
    typer.Option(
        help="A NetCDF file or Zarr store of currents, in place of the chosen ones; may be "
        "repeated for files that belong together, or given as a quoted pattern: 'daily/*.nc'. Or a "
        "source of the catalogue; 'still' plans without currents."
    ),
]


ExplainGapOption = Annotated[
    bool,
    typer.Option(
        "--explain-gap",
        help="Report the parts of the optimality gap; this may take as long as planning.",
    ),
]
StrictOption = Annotated[
    bool,
    typer.Option(
        "--strict",
        help="Plan nothing and exit with code 1 if a season's first choice of currents can't be "
        "used.",
    ),
]
