"""Kinds and file types of a case's figures, and how they are drawn to files."""

from collections.abc import Sequence
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

from pipeline.findings.names import safe_name
from pipeline.machine.files import needed, whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pipeline.findings.result import RunCase, RunResult


class Kind(StrEnum):
    """What a figure shows of a case: its map, or what the best route meets along the way."""

    ROUTES = "routes"
    ALONG = "along"


Form: TypeAlias = Literal["png", "svg", "pdf"]
"""File type of a figure."""

# Resolution of PNG files, dots per inch.
_DPI = 200
# Metadata without dates, so that equal figures give identical files.
_METADATA: dict[str, dict[str, str | None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


def draw(
    result: "RunResult",
    cases: Sequence["RunCase"],
    folder: Path,
    *,
    kinds: Sequence[Kind] = (),
    form: Form = "png",
) -> list[Path]:
    """Draw figures of cases, which have a route, to `folder/<case>-<figure>.<form>`.

    Returns the files. The folder is made if it does not exist; all `kinds` are drawn if none is
    given. Raises StageError if the figures can't be written.
    """
    files = []
    about = result.scenario.title or result.scenario.name
    for case, kind in product(cases, [kind for kind in Kind if not kinds or kind in kinds]):
        path = folder / f"{safe_name(case.name)}-{kind}.{form}"
        _save(figure(case, kind), path, f"{about}, {case.title}: {kind}")
        files.append(path)
    return files


def _save(drawing: "Figure", path: Path, title: str) -> None:
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


def figure(case: "RunCase", kind: Kind) -> "Figure":
    """Draw a figure of a case that has a route."""
    from pipeline.formats.appearance import season_colour
    from pipeline.formats.figures.chart_map import in_season_colour
    from pipeline.formats.figures.plots import profile_figure
    from pipeline.formats.figures.season_map import overview_figure

    if kind is Kind.ROUTES:
        return overview_figure([case])
    drawn = profile_figure(case.routes[0])
    in_season_colour(drawn, season_colour(case.number))
    return drawn
