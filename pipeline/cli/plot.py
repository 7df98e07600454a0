"""The command `renew plot`: draw a scenario's figures to files.

The figures show the results of an earlier run; seasons without results are planned first.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import RequestError, StageError
from pipeline.formats.figures.kinds import Form, Kind, Width, figure
from pipeline.formats.figures.method import Variant
from pipeline.formats.figures.turning import NothingToDrawError
from pipeline.formats.shared.result import RunResult
from pipeline.formats.shared.text import distance, season_text
from pipeline.machine.files import needed, whole_file
from pipeline.run import EventHandler, planned_scenario
from pipeline.scenario.loading import require_seasons
from pipeline.scenario.model import Scenario
from pipeline.session import Origin
from pipeline.stages.write import output_directory, safe_name

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
Planned = Callable[[Scenario], AbstractContextManager[RunResult]]


@dataclass(frozen=True, slots=True)
class Drawn:
    """The files that were written, and one line for each season that could not be planned.

    `skipped` has one line for each figure of a season that had no data for it.
    """

    directory: Path
    files: tuple[Path, ...]
    failures: tuple[str, ...]
    skipped: tuple[str, ...] = ()


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
        The kinds of figures, all if empty; and the format of their files.
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
    known = [season.name for season in scenario.seasons]
    require_seasons(scenario, seasons)
    chosen = [name for name in known if not seasons or name in seasons]
    selected = Kind.selected(tuple(kinds))
    planned = partial(
        planned_scenario, output=output, offline=offline, origin=origin, on_event=on_event
    )
    variants = compared_variants(scenario, selected, planned)
    # Figures are saved inside the block, so that another run can't replace the folder meanwhile.
    with planned(scenario) as result:
        failures = {
            entry.season: f"{season_text(entry.season)}: {entry.failure}"
            for entry in result.plans
            if entry.season in chosen and entry.failure
        }
        directory = output_directory(output.resolve(), scenario.name) / FOLDER
        files, skipped = [], []
        for name, kind in product((name for name in chosen if name not in failures), selected):
            try:
                drawing = figure(result, name, kind, width, variants)
            except NothingToDrawError as reason:
                skipped.append(f"{season_text(name)}: no figure {kind.value}: {reason}")
                continue
            path = directory / f"{safe_name(name)}-{kind.value}.{form.value}"
            about = result.scenario.title or scenario.name
            files.append(
                _save(drawing, path, f"{about}, {result.season_title(name)}: {kind.value}")
            )
    return Drawn(directory, tuple(files), tuple(failures.values()), tuple(skipped))


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


def compared_variants(
    scenario: Scenario, kinds: Sequence[Kind], planned: Planned
) -> dict[Kind, list[Variant]]:
    """Plan the variants that some kinds of figures compare; the store keeps their results.

    Small and large numbers of classes are compared with depth-first search, as in the paper. The
    fixed padding is the widest adaptive padding on any season's best route, so it is as safe.
    """
    variants: dict[Kind, list[Variant]] = {}
    if Kind.CLASSES in kinds:
        many = scenario.planner.classes
        variants[Kind.CLASSES] = [
            _variant(scenario, planned, f"k = {k}, depth-first", classes=k, order="depth-first")
            for k in dict.fromkeys((many if many > 1 else 16, 1))
        ]
    if Kind.PADDINGS in kinds:
        adaptive = _variant(scenario, planned, "adaptive padding", padding="adaptive")
        variants[Kind.PADDINGS] = [
            adaptive,
            _variant(scenario, planned, "no padding", padding="none", clearance=0.0),
        ]
        widest = _widest(adaptive.result)
        if widest > 0:
            title = f"fixed padding, {distance(widest * scenario.scale)}"
            variants[Kind.PADDINGS].append(_variant(scenario, planned, title, padding=widest))
    return variants


def _variant(scenario: Scenario, planned: Planned, title: str, **options: object) -> Variant:
    """Plan a scenario with changed planner options; if that fails, the variant has the reason."""
    planner = scenario.planner.model_copy(update=options)
    try:
        with planned(scenario.model_copy(update={"planner": planner})) as result:
            return Variant(title, result)
    except (RequestError, StageError) as error:
        return Variant(title, None, str(error))


def _widest(result: RunResult | None) -> float:
    """Return the widest padding on any season's best route, planar metres."""
    best = [one.route for one in result.routes if one.rank == 1] if result else []
    return max((float(route.padding_used[:, 4].max(initial=0.0)) for route in best), default=0.0)
