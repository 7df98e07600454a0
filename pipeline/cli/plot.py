"""Figures of a scenario to files: `renew plot`.

They are drawn from what an earlier run left in the store; what is not there is planned first.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pipeline.errors import RequestError, StageError
from pipeline.formats.figures.kinds import Form, Kind, figure
from pipeline.run import planned
from pipeline.stages.write import output_directory, safe_name

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from pipeline.run import Listener
    from pipeline.scenario.model import Scenario

FOLDER = "figures"
_DPI = 200
# No times: the same figure is the same file.
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


@dataclass(frozen=True, slots=True)
class Drawn:
    """The files that were written, and what could not be drawn, a line each."""

    directory: Path
    files: tuple[Path, ...]
    failures: tuple[str, ...]


def plot(
    scenario: Scenario,
    output: Path,
    *,
    seasons: Sequence[str] = (),
    kinds: Sequence[Kind] = (),
    form: Form = Form.PNG,
    offline: bool = False,
    listen: Listener | None = None,
) -> Drawn:
    """Draw a scenario's figures to `output/<scenario>/figures/<season>-<figure>.<form>`.

    Parameters
    ----------
    output
        Folder of all results, with the artefacts of earlier runs.
    seasons
        Names of seasons; all of them if none is named.
    kinds, form
        Which figures, all of them if none is named; and the form of their files.
    offline, listen
        As for a run.

    Raises
    ------
    RequestError
        The scenario has no season of a given name, or the request can't be planned.
    StageError
        Nothing could be planned, or the figures can't be written.
    """
    known = [season.name for season in scenario.seasons]
    faults = [
        f"{scenario.name} has no season {name!r}: it has {', '.join(known)}"
        for name in seasons
        if name not in known
    ]
    if faults:
        raise RequestError(faults)
    result = planned(scenario, output, offline=offline, listen=listen)
    chosen = [name for name in known if not seasons or name in seasons]
    failures = {
        entry.season: f"season {entry.season!r}: {entry.failure}"
        for entry in result.plans
        if entry.season in chosen and entry.failure
    }
    directory = output_directory(output.resolve(), scenario.name) / FOLDER
    files = [
        _save(
            figure(result, name, kind), directory / f"{safe_name(name)}-{kind.value}.{form.value}"
        )
        for name in chosen
        if name not in failures
        for kind in Kind.asked(tuple(kinds))
    ]
    return Drawn(directory, tuple(files), tuple(failures.values()))


def _save(drawing: Figure, path: Path) -> Path:
    """Write a figure under a temporary name, and rename it once it is whole."""
    import matplotlib as mpl

    form = path.suffix[1:]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = path.with_name(f".{secrets.token_hex(4)}.{form}")
        try:
            # Text that a journal can edit, and ids that don't change when the figure doesn't.
            with mpl.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "renew"}):
                drawing.savefig(fresh, dpi=_DPI, metadata=_METADATA[form])
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except OSError as error:
        raise StageError(
            f"plot: cannot write {path.name} to {path.parent}: {error.strerror or error}; make "
            "room or choose another place with --output"
        ) from error
    return path
