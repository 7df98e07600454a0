"""Bad names from outside are harmless in every format, and not lost."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import gpxpy
import pyogrio
import pytest
from lxml import etree

from pipeline.findings.names import safe_name
from pipeline.findings.result import RunResult
from pipeline.formats.gis.geopackage import write_geojson
from pipeline.formats.passage.routes import write_gpx, write_kml, write_rtz
from pipeline.formats.passage_plan import write_passage_plan
from pipeline.texts import clean
from tests.pipeline.formats import runs
from tests.pipeline.formats.passage.test_gpx import check_order
from tests.pipeline.formats.passage.test_kml import schema
from tests.pipeline.formats.passage.test_rtz import VERSIONS
from tests.validators import rtz_faults

NAMES = (
    "<script>alert(1)</script>",
    "../../etc/passwd",
    "a" * 300,
    "\N{SAILBOAT}\N{VARIATION SELECTOR-16} \N{FLAG IN HOLE}",
    "\N{RIGHT-TO-LEFT OVERRIDE}gpj.exe\N{POP DIRECTIONAL FORMATTING} \u05e9\u05dc\u05d5\u05dd",
    "tab\tnull\x00bell\x07escape\x1b[31mend",
    "half of a pair \ud83d",
    "quote\" apostrophe' &amp; ]]> <!-- -->",
    "not a character \uffff",
)


@pytest.fixture(params=NAMES, ids=range(len(NAMES)))
def named(request: pytest.FixtureRequest) -> tuple[str, RunResult]:
    """Give a run whose titles, vessel and credits all have such a name, as it comes in."""
    name = clean(request.param)
    result = runs.across_180()
    scenario = result.scenario.model_copy(
        update={
            "title": name,
            "description": name,
            "vessel": result.scenario.vessel.model_copy(update={"title": name}),
        }
    )
    land = replace(
        result.fetched.land,
        credits=tuple(replace(credit, text=name) for credit in result.fetched.land.credits),
    )
    return name, replace(result, scenario=scenario, fetched=replace(result.fetched, land=land))


@pytest.mark.gate_share(9)
@pytest.mark.parametrize("version", VERSIONS)
def test_rtz(named: tuple[str, RunResult], tmp_path: Path, version: str) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.rtz"
    outputs = result.scenario.outputs.model_copy(update={"rtz_version": version})
    scenario = result.scenario.model_copy(update={"outputs": outputs})
    write_rtz(replace(result, scenario=scenario).case(runs.SEASON), path)
    root = etree.parse(path).getroot()
    assert not any(rtz_faults(root, version))
    assert root[0].get("routeName") == path.stem
    # An attribute's white space is spaces; a long title gives way to the vessel's name.
    short = name if len(name) <= 32 else result.scenario.vessel.name
    assert root[0].get("vesselName").split() == short.split()
    texts = {element.tag.rpartition("}")[2]: element.text for element in root.iter()}
    assert texts["title"].startswith(name)
    assert texts["description"] == name
    assert name in texts["credits"]


@pytest.mark.usefixtures("every_driver")
def test_gpx(named: tuple[str, RunResult], tmp_path: Path) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.gpx"
    write_gpx(result.case(runs.SEASON), path, every=True)
    check_order(etree.parse(path).getroot())
    gpx = gpxpy.parse(path.read_text(encoding="utf-8"))
    assert (gpx.name or "").startswith(name)
    assert (gpx.description or "").count(name) == 2
    assert name.split()[0] in (gpx.copyright_author or "")
    assert len(pyogrio.read_dataframe(path, layer="routes")) == len(result.routes)


def test_kml(named: tuple[str, RunResult], tmp_path: Path) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.kml"
    write_kml(result.case(runs.SEASON), path)
    root = etree.parse(path).getroot()
    schema().assertValid(root)
    assert root[0][0].text.startswith(name)


@pytest.mark.gate_share(3)
def test_passage_plan(named: tuple[str, RunResult], tmp_path: Path) -> None:
    """Every name is drawn without a warning; characters that the font lacks are white squares."""
    write_passage_plan(named[1], tmp_path / "passage-plan.pdf")
    assert (tmp_path / "passage-plan.pdf").read_bytes().startswith(b"%PDF")


def test_geojson(named: tuple[str, RunResult], tmp_path: Path) -> None:
    name, result = named
    path = tmp_path / f"{safe_name(name)}.geojson"
    write_geojson(result.case(runs.SEASON), path)
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["title"].startswith(name)
    assert name in content["credits"]
    assert len(pyogrio.read_dataframe(path)) == len(content["features"])


def test_a_text_of_a_megabyte_is_shortened(tmp_path: Path) -> None:
    result = runs.across_180()
    path = tmp_path / "a.rtz"
    long = replace(result, scenario=result.scenario.model_copy(update={"description": "x" * 10**6}))
    write_rtz(long.case(runs.SEASON), path)
    assert path.stat().st_size < 100_000
