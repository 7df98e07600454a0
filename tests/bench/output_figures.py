"""Figures of what a run writes: how soon, how large, and what its referees say."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from lxml import etree
from playwright.sync_api import Browser

from tests.bench.figure import Figure, at_most
from tests.bench.pipeline_figures import run_scenario
from tests.pipeline.formats.report.big_page import measure, write_big_page
from tests.validators import axe_faults, chromium, geopackage_faults, rtz_faults

_NOT_HERE = "not measured: it is not installed"
_TIMES = 5


def figures() -> Iterator[Figure]:
    """Yield the figures of `palawan-season`'s files, then those of the largest report."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        run_scenario("palawan-season", Path(folder), "--offline", "--json", log=log)
        yield at_most("palawan-season: all outputs written", _writing_s(log), 5, " s")
        files = Path(folder) / "palawan-season"
        yield _faults("routes.gpkg: GDAL's checker", geopackage_faults(files / "routes.gpkg"))
        for path in sorted(files.glob("*.rtz")):
            found = rtz_faults(etree.parse(path).getroot(), "1.1")
            yield _faults(f"{path.name}: schema", "".join(found))
        with chromium() as browser:
            yield from _report(browser, files / "report.html", Path(folder) / "big.html")


def _writing_s(log: Path) -> float:
    """Seconds of the stage that writes, out of a run's log lines."""
    lines = (json.loads(line) for line in log.read_text(encoding="utf-8").splitlines())
    return float(
        next(
            line["seconds"]
            for line in lines
            if line["stage"] == "write" and line["event"] == "done"
        )
    )


def _report(browser: Browser | None, report: Path, big: Path) -> Iterator[Figure]:
    """Yield the figures of a report, and of one as large as they get."""
    write_big_page(big)
    yield at_most("report.html, the largest: size", big.stat().st_size / 1e6, 2, " MB")
    if browser is None:
        yield Figure("report.html in Chromium", "", _NOT_HERE)
        return
    for name, path in (("the largest", big), ("palawan-season", report)):
        ready = sorted(measure(browser, path).ready_s for _ in range(_TIMES))
        text = f"{ready[0]:.2f} to {ready[-1]:.2f} s, median {ready[_TIMES // 2]:.2f} s"
        yield Figure(f"report.html, {name}: ready", "< 1 s", text, ready[_TIMES // 2] < 1)
    page = browser.new_page()
    page.goto(report.as_uri())
    page.wait_for_selector("html[data-ready]", state="attached")
    yield _faults("report.html: axe, serious or critical", axe_faults(page))


def _faults(name: str, found: Sequence[str] | str | None) -> Figure:
    """Figure of a referee that should find nothing."""
    if found is None:
        return Figure(name, "0", _NOT_HERE)
    return Figure(name, "0", str(found) if found else "0", not found)
