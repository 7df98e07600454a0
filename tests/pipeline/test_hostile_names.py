"""Names that act on terminals, viewers and spreadsheets, through each input: none gets out."""

import csv
import io
import json
import sqlite3
import zipfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
from lxml import etree
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.errors import PipelineError
from pipeline.nightly.cases import read_pairs
from pipeline.scenario.loading import load_scenario
from pipeline.sources.cf.dataset import open_dataset
from pipeline.sources.land.s57 import Objects
from pipeline.sources.land.vector import read_havens
from pipeline.sources.tide_stations import read_station
from tests.pipeline.nightly.nights import write_forecast
from tests.pipeline.small_region import small_region
from tests.pipeline.test_texts import forbidden

# Each acts somewhere: the clipboard, the screen, the title, C1 escapes, the direction of text, a
# new line in a log, half of a pair, a formula, what can't be seen, NUL.
TRICKS = (
    "Isle\x1b]52;c;cm0gLXJm\x07",
    "\x1b[2J\x1b[HIsle",
    "Isle\x1b]0;owned\x1b\\",
    "\x9b31mIsle\x9d0;x\x9c",
    "Isle \u202egpj.exe\u202c \u2066x\u2069",
    "Isle\u2028error: all is lost\u2029\x85x\r\nnote: y",
    "Isle \ud83d half",
    "=cmd|'/C calc'!A0",
    "+1+cmd|' /C calc'!A0",
    "@SUM(1+1)*cmd|x",
    "-2+3\tIsle",
    "Is\u200ble\ufeff\u2060\u00ad\U000e0041 two",
    "Isle\x00\x01\x08\x7f\uffff",
)

# GDAL ends a text before half of a pair and before NUL: such havens would be called the same.
HAVENS = tuple(one for one in TRICKS if "half" not in one)


def _shown(text: str) -> set[str]:
    """Return the forbidden characters of a printed text or a file, apart from its lines."""
    return forbidden(text.replace("\r\n", "\n").replace("\n", " ").replace("\t", " "))


def _texts(value: object) -> Iterator[str]:
    """Yield every text in a value of JSON, keys too."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from (str(key), *_texts(one))
    elif isinstance(value, list):
        for one in value:
            yield from _texts(one)


def _written(name: str, content: bytes) -> Iterator[str]:
    """Yield the texts that a reader of a file finds in it."""
    suffix = Path(name).suffix
    if suffix in {".json", ".geojson", ".plan"}:
        yield from _texts(json.loads(content))
    elif suffix in {".gpx", ".rtz", ".qgs", ".qml"}:
        for node in etree.fromstring(content).iter():
            yield from (*(node.attrib.values()), node.text or "", node.tail or "")
    elif suffix in {".zip", ".qgz"}:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            for one in packed.namelist():
                yield from (one, *_written(one, packed.read(one)))
    elif suffix in {".html", ".csv", ".toml", ".waypoints"}:
        yield content.decode()


def _stored(path: Path) -> Iterator[str]:
    """Yield the texts of a GeoPackage, or of a NetCDF file's attributes."""
    if path.suffix == ".nc":
        with netCDF4.Dataset(path) as data:
            owners: list[Any] = [data, *data.variables.values()]
            for owner in owners:
                yield from (str(owner.getncattr(key)) for key in owner.ncattrs())
        return
    with closing(sqlite3.connect(path)) as database:
        listed = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'rtree%'"
        for (table,) in database.execute(listed).fetchall():
            for row in database.execute(f'SELECT * FROM "{table}"'):  # noqa: S608 - its own
                yield from (one for one in row if isinstance(one, str))


def _points(names: tuple[str, ...], lon: float, lat: float) -> str:
    """Return havens of some names, as GeoJSON."""
    return _features([("Point", [lon + 0.002 * i, lat], name) for i, name in enumerate(names)])


def _features(given: list[tuple[str, Any, str]]) -> str:
    """Return features with names, as GeoJSON."""
    features = [
        {
            "type": "Feature",
            "properties": {"name": name},
            "geometry": {"type": kind, "coordinates": place},
        }
        for kind, place, name in given
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def _square(lon: float, lat: float, half: float = 0.004) -> list[list[list[float]]]:
    west, south, east, north = lon - half, lat - half, lon + half, lat + half
    return [[[west, south], [east, south], [east, north], [west, north], [west, south]]]


def _toml(text: str) -> str:
    """Spell a text in TOML, which has no halves of pairs."""
    return '"' + "".join(f"\\U{ord(c):08X}" for c in text if not "\ud800" <= c <= "\udfff") + '"'


@pytest.fixture(scope="module")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A voyage whose chart, havens, currents, vessel and titles have such names."""
    folder = tmp_path_factory.mktemp("hostile")
    islands = [
        ("Polygon", _square(118.43 + 0.012 * i, 10.25), name) for i, name in enumerate(TRICKS)
    ]
    (folder / "chart.geojson").write_text(_features(islands))
    (folder / "havens.geojson").write_text(_points(HAVENS[6:7], 118.44, 10.22))
    forecast = write_forecast(folder / "currents.nc", steps=2)
    with netCDF4.Dataset(forecast, "a") as data:
        for key, trick in zip(
            ("title", "institution", "credit", "source", "license", "references", "history"),
            TRICKS,
            strict=False,
        ):
            data.setncattr(key, trick.replace("\x00", "").replace("\ud83d", ""))
        data["uo"].long_name = TRICKS[2]
    all_tricks = " ".join(TRICKS)
    (folder / "scenario.toml").write_text(
        small_region("hostile")
        .replace("scale = 1000", "scale = 1")
        .replace("[118.60, 10.30]", "[118.50, 10.20]")
        .replace(
            'vessel = "paper-asv"',
            f"title = {_toml(TRICKS[0])}\ndescription = {_toml(all_tricks)}\n",
        )
        + f"""[vessel]
title = {_toml(TRICKS[3])}
origin = {_toml(TRICKS[5])}
length_m = 7
speed_m_s = 5
turn_rate_deg_s = 16.5
[chart]
source = {{ path = "chart.geojson", credit = {_toml(TRICKS[7])}, licence = {_toml(TRICKS[4])} }}
[havens]
path = "havens.geojson"
within = "6h"
[[seasons]]
name = "now"
title = {_toml(TRICKS[1])}
valid = "2026-11-21"
currents = ["./currents.nc"]
[planner]
classes = 1
"""
    )
    words = ["run", str(folder / "scenario.toml"), "--output", str(folder / "out")]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    printed = done.stdout + done.stderr
    assert done.exit_code == 0, printed
    return folder / "out" / "hostile", printed


def test_no_plan_is_lost_and_nothing_acts_on_the_terminal(sailed: tuple[Path, str]) -> None:
    folder, printed = sailed
    assert not _shown(printed)
    assert "Isle" in printed
    assert {"report.html", "havens.csv", "routes.gpkg"} <= {path.name for path in folder.iterdir()}


def test_no_file_of_the_results_has_them(sailed: tuple[Path, str]) -> None:
    folder, _ = sailed
    seen = 0
    for path in folder.iterdir():
        is_stored = path.suffix in {".nc", ".gpkg"}
        for text in _stored(path) if is_stored else _written(path.name, path.read_bytes()):
            seen += "Isle" in text
            assert not _shown(text), (path.name, ascii(text))
    assert seen > 40


def test_no_cell_is_a_formula(sailed: tuple[Path, str]) -> None:
    folder, _ = sailed
    cells = set[str]()
    for path in folder.glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            cells |= {cell for row in csv.reader(file) for cell in row}
    assert any(cell.startswith("'=cmd|") for cell in cells)
    for cell in cells:
        if cell[:1] in "=+-@" and len(cell) > 1:
            float(cell)


@pytest.mark.parametrize("trick", TRICKS, ids=range(len(TRICKS)))
def test_each_reader_cleans_what_it_reads(tmp_path: Path, trick: str) -> None:
    """Havens in GeoJSON and CSV, a chart's objects, a station in JSON and TOML, attributes."""
    found = list[str]()
    (tmp_path / "havens.geojson").write_text(_points((trick,), 118.0, 10.0))
    found += list(read_havens(tmp_path / "havens.geojson"))
    objects = Objects(np.empty(1, dtype=object), {"OBJNAM": np.array([trick], dtype=object)})
    found += objects.texts("OBJNAM")
    rows = [{"name": n, "amplitude": 0.5, "phase": 10.0} for n in ("M2", "S2", "K1", "O1")]
    station = {
        "name": trick,
        "latitude": 10.0,
        "longitude": 118.0,
        "chart_datum": "MLLW",
        "datums": {"MLLW": 0.0, "MSL": 1.0},
        "harmonic_constituents": rows,
        "source": {"name": trick, "id": trick},
    }
    (tmp_path / "station.json").write_text(json.dumps(station))
    read = read_station(tmp_path / "station.json")
    found += [read.name, read.credit]
    path = write_forecast(tmp_path / "a.nc", steps=1)
    with netCDF4.Dataset(path, "a") as data:
        data.title = data["uo"].long_name = trick.replace("\x00", "").replace("\ud83d", "")
    with open_dataset(path) as opened:
        found += [opened.attrs["title"], opened["uo"].attrs["long_name"]]
    assert len(found) == 6
    for text in found:
        assert not forbidden(text), ascii(text)
        assert text


@pytest.mark.parametrize("trick", TRICKS, ids=range(len(TRICKS)))
def test_each_refusal_that_quotes_a_file_is_clean(tmp_path: Path, trick: str) -> None:
    (tmp_path / "pairs.csv").write_bytes(
        f"{trick},start_lon\n1,2\n".encode(errors="surrogatepass").replace(b"\xed\xa0\xbd", b"?")
    )
    text = small_region("x") + f"[[seasons]]\nname = {_toml(trick)}\n{_toml(trick)} = 1\n"
    (tmp_path / "keys.toml").write_text(text)
    (tmp_path / "bad.toml").write_bytes(f"a = {trick}".encode(errors="replace"))
    said = list[str]()
    for name in ("keys.toml", "bad.toml"):
        with pytest.raises(PipelineError) as caught:
            load_scenario(str(tmp_path / name))
        said.append(str(caught.value))
    _, faults = read_pairs(tmp_path / "pairs.csv", is_planar=False)
    said += PipelineError("\n".join(fault.replace("\n", " ") for fault in faults)).args
    for asked in (trick.replace("\x00", ""), f"{trick}.toml"):
        done = CliRunner().invoke(app, ["check", asked])
        assert done.exit_code == 2
        said.append(done.stderr)
    for text in said:
        assert not _shown(text), ascii(text)


def test_a_file_that_is_shown_does_not_act(tmp_path: Path) -> None:
    text = "# \u202ea\x9b31m\x7f\u200b\nname = 'x'  # \u2066b\n\tindent = 1\n"
    (tmp_path / "shown.toml").write_text(text.replace("\x7f", ""))
    done = CliRunner().invoke(app, ["show", str(tmp_path / "shown.toml")])
    assert done.stdout == "# a\ufffd31m\nname = 'x'  # b\n\tindent = 1\n"


@pytest.mark.parametrize("trick", ["a\x1b]0;x\x07", "a\u202eb", "a\x9bb", "a\u200bb", "a\nb"])
def test_a_file_with_such_a_name_is_refused(tmp_path: Path, trick: str) -> None:
    """Its name would get into notes, credits and results; where a pattern finds it, too."""
    folder = tmp_path / "currents"
    write_forecast(folder / "a.nc", steps=1).rename(folder / f"{trick}.nc")
    text = small_region("x") + "[[seasons]]\nname = 'now'\nvalid = '2026-11'\n"
    (tmp_path / "scenario.toml").write_text(f"{text}currents = ['./currents/*.nc']\n")
    done = CliRunner().invoke(app, ["check", str(tmp_path / "scenario.toml")])
    assert done.exit_code == 2
    assert "has in its name U+" in done.stderr
    assert "; rename it" in done.stderr
    assert not _shown(done.stderr)
