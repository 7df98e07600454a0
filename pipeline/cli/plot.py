"""The command `renew plot`: draw a scenario's figures to files.

The figures show the results of an earlier run; seasons without results are planned first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.findings.names import output_directory, safe_name
from pipeline.findings.text import season_text
from pipeline.formats.figures.kinds import Form, Kind, Width, figure
from pipeline.machine.files import needed, whole_file
from pipeline.run import EventHandler, planned_scenario
from pipeline.scenario.loading import require_seasons
from pipeline.scenario.model import Scenario
from pipeline.session import Origin

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FOLDER = "figures"
# Resolution of PNG files, dots per inch.
_DPI = 200
# Metadata without dates, so that equal figures give identical files.
_METADATA: dict[str, dict[str, str | None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


@dataclass(frozen=True, slots=True)
class Drawn:
    """The files that were written, and one line for each season that could not be planned."""

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
    width: Width = Width.SCREEN,
    offline: bool = False,
    origin: Origin | None = None,
    on_event: EventHandler | None = None,
) -> Drawn:
    """Draw a scenario's figures to `output/<scenario>/figures/<season>-<figure>.<form>`.

    Parameters
    ----------
    output
        Folder of all results, and of the store.
    seasons
        Names of seasons; all if empty.
    kinds, form
        The kinds of figures, both if empty; and the format of their files.
    width
        Width of a journal's column, of its page, or of a screen.
    offline, origin, on_event
        As for `run`.

    Raises
    ------
    RequestError
        The scenario has no season of a given name, or the request can't be planned.
    StageError
        Nothing could be planned, or the figures can't be written.
    """
    require_seasons(scenario, seasons)
    chosen = [one.name for one in scenario.seasons if not seasons or one.name in seasons]
    selected = [kind for kind in Kind if not kinds or kind in kinds]
    # Figures are saved inside the block, so that another run can't replace the folder meanwhile.
    with planned_scenario(
        scenario, output, offline=offline, origin=origin, on_event=on_event
    ) as result:
        cases = [case for case in result.cases if case.name in chosen]
        failures = [
            f"{season_text(case.name)}: {case.result.failure}" for case in cases if not case.routes
        ]
        directory = output_directory(output.resolve(), scenario.name) / FOLDER
        files = []
        for case, kind in product((case for case in cases if case.routes), selected):
            path = directory / f"{safe_name(case.name)}-{kind.value}.{form.value}"
            about = result.scenario.title or scenario.name
            title = f"{about}, {case.title}: {kind.value}"
            files.append(_save(figure(case, kind, width), path, title))
    return Drawn(directory, tuple(files), tuple(failures))


def _save(drawing: "Figure", path: Path, title: str) -> Path:
    """Write a figure with its title under a temporary name, and rename the complete file."""
    import matplotlib as mpl

    form = path.suffix[1:]
    remedy = "free some space, or choose another folder with --output"
    with needed(f"plot: cannot write {path.name} to {path.parent}", remedy):
        path.parent.mkdir(parents=True, exist_ok=True)
        # Text stays text in PDF files; ids in SVG files depend only on the figure.
        settings = mpl.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "renew"})
        with settings, whole_file(path) as file:
            about = {**_METADATA[form], "Title": title}
            drawing.savefig(file, format=form, dpi=_DPI, metadata=about)
    return path
