"""The command line: `renew run|go|replan|plot|list|show|check|clean|nightly|tide` and more.

Exit codes:

- 0: success.
- 1: a season failed and the others are written; or the machine or network failed; or `--strict`
  refused.
- 2: the request is wrong and nothing is written; each fault has its own line.
- 3: an unexpected error; one line of JSON says where to report it.
- 4, 5, 10: only from `renew nightly`: another job is running; no new currents yet; published, but
  an operator should check the results.
- 130, 143: stopped by Ctrl-C or SIGTERM; finished stages are kept.

Results go to standard output; progress, notes and errors to standard error.
"""

import atexit
import contextlib
import gc
import json
import os
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli import failures, options, upkeep
from pipeline.cli.failures import reported_errors
from pipeline.cli.nightly import app as nightly_app
from pipeline.cli.terminal import say, still_at_work
from pipeline.cli.tide import app as tide_app
from pipeline.errors import Faults, RequestError, StageError
from pipeline.formats.figures.kinds import Form, Kind
from pipeline.machine.interpreters import ignoring_working_directory, seldom_collecting
from pipeline.texts import seen
from pipeline.voyage.positions import halves
from pipeline.voyage.request import UnderWayRequest, VoyageRequest, read_voyage
from pipeline.voyage.table import read

if TYPE_CHECKING:
    from pipeline.scenario.catalogue import ScenarioFile
    from pipeline.scenario.model import Scenario

app = options.group(
    name="renew",
    cls=options.BriefRefusals,
    help="Vessel routes that are safe and cheap in ocean currents.",
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Entry point `renew`."""
    _open_missing_streams()
    # At its end the interpreter would look for garbage among all objects for 0.4 s.
    atexit.register(gc.freeze)
    with failures.ending_promptly(), ignoring_working_directory(), seldom_collecting():
        app()


def _open_missing_streams() -> None:
    """Open streams that the caller closed (`2>&-`); otherwise other files get their descriptors."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            null = os.open(os.devnull, os.O_RDWR)
            if null != descriptor:
                os.dup2(null, descriptor)
                os.close(null)
            setattr(sys, name, open(descriptor, "r" if name == "stdin" else "w", closefd=False))  # noqa: SIM115 - lives as long as the program


def _version(asked: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if asked:
        with reported_errors():
            typer.echo(f"renew {failures.program_version()}")
        raise typer.Exit


@app.callback()
def root(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Vessel routes that are safe and cheap in ocean currents."""
    del version


_GB = 1_000_000_000


@options.command(app, "run")
def run(
    scenario: str,
    *,
    output: Path = Path("outputs"),
    offline: bool = False,
    charts: list[str] | None = None,
    currents: list[str] | None = None,
    strict: bool = False,
    as_json: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    limit: float | None = None,
    scheduler: str | None = None,
) -> None:
    """Plan a scenario's routes and write them to OUTPUT/<scenario>/."""
    with _loaded(scenario, output, charts, currents) as (wanted, origin, notes):
        from pipeline.cli.reporting import run_to_end
        from pipeline.run import run as run_scenario

        run = partial(
            run_scenario,
            wanted,
            output,
            offline=offline,
            strict=strict,
            scheduler=scheduler,
            limit_s=limit,
            origin=origin,
        )
        run_to_end(run, wanted, notes, as_json=as_json, quiet=quiet, verbose=verbose)


@options.command(app, "go")
@options.with_options(VoyageRequest, without=("start", "goal"))
def go(
    positions: list[str],
    *,
    as_json: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    **given: Any,  # the options of a voyage
) -> None:
    """Plan a voyage from START to GOAL; region, chart and currents are chosen and reported.

    The scenario is written beside the results, for `renew run`.
    """
    faults = Faults()
    start, goal = faults.collect(lambda: halves(positions)) or (None, None)
    request = read_voyage({**given, "start": start, "goal": goal}, "command", faults.lines)
    from pipeline.cli.reporting import run_to_end
    from pipeline.voyage.one_line import run_or_keep, voyage_scenario

    scenario, notes = voyage_scenario(request)
    run = partial(run_or_keep, request, scenario, said=notes)
    run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet, verbose=verbose)


# What a route of one's own leaves open, or says itself.
_OF_A_PLAN = (
    "start", "goal", "via", "until", "arrive_by", "havens", "within", "endurance", "members",
    "strict",
)  # fmt: skip


@options.command(app, "check-route")
@options.with_options(VoyageRequest, without=(*_OF_A_PLAN, "speed"))
def check_route(
    file: Path,
    *,
    speed: str | None = None,
    as_json: bool = False,
    quiet: bool = False,
    **given: Any,  # the options of a voyage
) -> None:
    """Say what a route of yours costs in fuel and time, and whether it is safe.

    Beside it stand the least-fuel route of its own side, and the best of all. A departure that is
    left out is the one that the file states. Exits with 1 if the route crosses land or a
    shut area, or a season could not be checked.
    """
    from pipeline.cli.checking import print_check
    from pipeline.cli.reporting import progress
    from pipeline.voyage.check import check_route as checked
    from pipeline.voyage.one_line import voyage_scenario
    from pipeline.voyage.route_file import read_route

    route = read_route(file)
    if not given["depart"] and not given["month"] and route.points[0].time:
        given["depart"] = route.points[0].time
    if ".." in (speed or ""):
        raise RequestError(f"--speed {speed}: a route is checked at one speed; give one, as 12kn")
    request = read_voyage({**given, **route.stops, "speed": speed}, "command")
    asked = voyage_scenario(request)
    with progress(*asked, quiet=quiet, as_json=as_json) as on_event:
        run, found = checked(request, asked, route, on_event)
    print_check(run, found, route, request.depart, as_json=as_json)


@options.command(app, "serve")
def serve(
    *,
    port: int | None = None,
    opens: bool = False,
    output: Path = Path("outputs"),
    offline: bool = False,
    limit: float = 600.0,
    memory: float = 4.0,
    workers: int = 1,
) -> None:
    """Serve a page on this machine where voyages are planned on a map; needs the extra `web`.

    It answers on 127.0.0.1 only, and needs the token in the address that it prints.
    """
    try:
        from pipeline.serve.app import serve as serve_page
        from pipeline.serve.plans import Plans
    except ImportError as error:
        raise StageError(
            f"renew serve needs the extra `web` ({error}): pip install fastapi uvicorn"
        ) from error

    from pipeline.machine.paths import folder_to_write

    def tell(address: str) -> None:
        typer.echo(address)
        say(
            "Open it in a browser on this machine. Who has it may plan here, so keep it to "
            "yourself. Ctrl-C ends.",
            err=True,
        )
        if opens:
            webbrowser.open(address)

    plans = Plans(
        folder_to_write(output, "--output"),
        offline=offline,
        workers=workers,
        limit_s=limit,
        memory_bytes=round(memory * _GB),
    )
    serve_page(plans, port, on_ready=tell)


@options.command(app, "replan")
@options.with_options(UnderWayRequest)
def replan(
    *,
    as_json: bool = False,
    quiet: bool = False,
    verbose: bool = False,
    **given: Any,  # the options of a voyage under way
) -> None:
    """Plan the rest of a voyage again from where the vessel is, in a folder beside RESULTS.

    The way that was planned is kept, unless it can't be sailed or another saves more than 2 % of
    the fuel ahead. The answer is no command to a vessel.
    """
    from pipeline.cli.reporting import run_to_end
    from pipeline.machine.paths import expanded
    from pipeline.run import run as run_scenario
    from pipeline.stages.under_way import finished_season
    from pipeline.voyage.under_way import under_way_scenario

    faults = Faults()
    results = Path(given["results"])
    finished = faults.collect(lambda: finished_season(results, given["season"] or ""))
    request = read(UnderWayRequest, given, "command", known=faults.lines)
    scenario, notes = under_way_scenario(request, finished)
    beside = expanded(results, "RESULTS").absolute().parent
    run = partial(run_scenario, scenario, beside, offline=request.offline, said=notes)
    run_to_end(run, scenario, notes, as_json=as_json, quiet=quiet, verbose=verbose)


app.add_typer(nightly_app, name="nightly")
app.add_typer(tide_app, name="tide")
app.add_typer(upkeep.qgis_app, name="qgis")


@options.command(app, "plot")
def plot(
    scenario: str,
    *,
    season: list[str] | None = None,
    figure: list[Kind] | None = None,
    form: Form = "png",
    output: Path = Path("outputs"),
    offline: bool = False,
    charts: list[str] | None = None,
    currents: list[str] | None = None,
) -> None:
    """Draw a scenario's figures to OUTPUT/<scenario>/figures/.

    They show the results of an earlier run; seasons without results are planned first.
    """
    with _loaded(scenario, output, charts, currents, seasons=season or ()) as loaded:
        wanted, origin, notes = loaded
        from pipeline.cli.reporting import progress
        from pipeline.findings.names import output_directory
        from pipeline.findings.text import season_text
        from pipeline.formats.figures.kinds import draw
        from pipeline.machine.paths import short_path
        from pipeline.run import planned_scenario

        # Figures are saved inside the block, so that no other run replaces the folder meanwhile.
        with (
            progress(wanted, notes) as on_event,
            planned_scenario(
                wanted, output, offline=offline, origin=origin, on_event=on_event
            ) as result,
        ):
            cases = [case for case in result.cases if not season or case.name in season]
            planned = [case for case in cases if case.routes]
            folder = output_directory(output.resolve(), wanted.name) / "figures"
            files = draw(result, planned, folder, kinds=figure or (), form=form)
        for file in files:
            typer.echo(short_path(file))
        for case in cases:
            if not case.routes:
                say(f"error: {season_text(case.name)}: {case.result.failure}", err=True)
        raise typer.Exit(0 if planned == cases else 1)


@options.command(app, "list")
def list_entries(*, as_json: bool = False) -> None:
    """List the catalogue: scenarios and what they need, vessels, sources, stations of the tide."""
    from pipeline.scenario import catalogue

    sections = catalogue.listed()
    if as_json:
        typer.echo(json.dumps(sections, ensure_ascii=False))
        return
    width = max(len(entry["name"]) for entries in sections.values() for entry in entries) + 1
    for section, entries in sections.items():
        typer.echo(f"{section}:")
        for entry in entries:
            needs = f" ({entry['needs']})" if entry["needs"] else ""
            typer.echo(f"  {entry['name']:<{width}}{entry['title']}{needs}")


@options.command(app, "show")
def show(name: str) -> None:
    """Print an entry of the catalogue as TOML, for example as a template for a new one."""
    from pipeline.scenario import catalogue

    path = catalogue.entry_path(name)
    catalogue.read_toml(path)
    typer.echo(seen(path.read_text(encoding="utf-8")), nl=False)


@options.command(app, "check")
def check(file: str) -> None:
    """List faults of a scenario, its start and goal, and its files, but for values of currents."""
    with still_at_work():
        from pipeline.scenario.loading import load_scenario

        scenario = load_scenario(file)
        # After loading, so that faults in the file are reported at once.
        from pipeline.stages.region import require_sailable, require_whole_files

        require_sailable(scenario)
        require_whole_files(scenario)
        seasons = ", ".join(season.name for season in scenario.seasons)
        vessel = scenario.vessel
        named = f"vessel {vessel.name}" if vessel.label else f"vessel of {vessel.length_m:g} m"
        typer.echo(f"{scenario.name}: valid ({seasons}; {named}; 1:{scenario.scale:g})")


@options.command(app, "clean")
def clean(
    *,
    output: Path = Path("outputs"),
    older: str = "30d",
    everything: bool = False,
    yes: bool = False,
) -> None:
    """Free space: remove stored stages and downloads from OUTPUT/.artefacts/, never results."""
    if everything and not yes:
        upkeep.require_consent()
    with still_at_work():
        say(upkeep.freed(output, older=older, everything=everything))


@options.command(app, "doctor")
def doctor(*, output: Path = Path("outputs"), offline: bool = False, as_json: bool = False) -> None:
    """Check that this machine can run RENEW; exit code 1 if something would make a run fail."""
    with still_at_work():
        findings = []
        for finding in upkeep.examine(output, offline=offline):
            findings.append(finding)
            if not as_json:
                say(str(finding))
        exit_code = int(any(finding.state == "fault" for finding in findings))
        if as_json:
            fields = [asdict(finding) for finding in findings]
            typer.echo(json.dumps({"exit_code": exit_code, "findings": fields}))
        raise typer.Exit(exit_code)


@options.command(app, "warm")
def warm() -> None:
    """Compile the planner's code now, so that the first plan does not have to wait for it."""
    with still_at_work():
        typer.echo(upkeep.warm())


@contextlib.contextmanager
def _loaded(
    asked: str,
    output: Path,
    charts: Sequence[str] | None,
    currents: Sequence[str] | None,
    *,
    seasons: Sequence[str] = (),
) -> "Iterator[tuple[Scenario, ScenarioFile, list[str]]]":
    """Read and check a scenario before slow imports, so that all faults are reported at once.

    Yield it with its file, and notes on how it was loaded. A RequestError in the block gets a note
    if the output folder has results of an earlier run.
    """
    from pipeline.machine.paths import folder_to_write
    from pipeline.scenario.catalogue import read_scenario
    from pipeline.scenario.loading import load_scenario
    from pipeline.voyage.readers import read_charts

    notes: list[str] = []
    faults = Faults()
    faults.collect(lambda: folder_to_write(output, "--output"))
    file = faults.collect(lambda: read_scenario(asked))
    with failures.dating_earlier_results(output, file.table.get("name") if file else None):
        if file is None:
            raise RequestError(faults.lines)
        try:
            sources = read_charts(charts or ())
        except ValueError as error:
            sources = ()
            faults.lines += [f"--charts {fault}" for fault in error.args]
        read = partial(load_scenario, file, charts=sources, currents=currents or ())
        scenario = faults.collect(partial(read, on_note=notes.append))
        if scenario is not None:
            known = [season.name for season in scenario.seasons]
            faults.lines += [
                f"{scenario.name} has no season {name!r}: it has {', '.join(known)}"
                for name in seasons
                if name not in known
            ]
        if scenario is None or faults.lines:
            raise RequestError(faults.lines)
        yield scenario, file, notes


if __name__ == "__main__":
    main()
