"""What the documents claim is what was measured, and what they name exists.

Where each figure stands is in claims.toml, and what was measured in docs/figures/.
"""

import csv
import dataclasses
import inspect
import math
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import pytest
from pydantic import BaseModel

import renew
from experiments.environments.model import Case, EnvironmentSpec
from pipeline.findings.text import rounded_down, rounded_up
from pipeline.nightly.config import CaseSpec, DepartureSpec, NightSpec
from pipeline.scenario.catalogue import VesselSpec
from pipeline.sources.cf.harmonic_fit import CONSTITUENTS
from pipeline.sources.tide_stations import OwnConstant, OwnStation
from renew.inputs.options import Changes
from tests import reference
from tests.bench.__main__ import SUITES
from tests.bench.figure import COLUMNS, FOLDER, recorded
from tests.conftest import ROOT
from tests.reference import BEGIN, END, METRICS
from tests.test_docs import DOCUMENTS, FENCE, SHELL, SPAN

QUOTES = tomllib.loads((ROOT / "tests" / "claims.toml").read_text("utf-8"))
"""Texts (`quoted`) and figures that are measured by nobody (`given`), by page."""


# Figures that are limits, by their names: the greatest that may be, and the least.
_GREATEST = re.compile(r"gap|most|worst|above|dearest|beside|from_a_point|filled")
_LEAST = re.compile(r"bound|clearance|least")


class Limit(float):
    """A figure that is written on its safe side: a greatest one rounded up, a least one down."""

    is_greatest: bool

    @classmethod
    def of(cls, name: str, value: float) -> float:
        """Return a figure as its name asks for it; as it is where it is no limit."""
        if not (_GREATEST.search(name) or _LEAST.search(name)):
            return value
        limit = cls(value)
        limit.is_greatest = _GREATEST.search(name) is not None
        return limit

    def __format__(self, spec: str) -> str:
        """Write it with the decimals of a format such as .2f."""
        digits = re.fullmatch(r",?\.(\d)f", spec)
        if digits is None:
            return format(float(self), spec)
        rounded = rounded_up if self.is_greatest else rounded_down
        return format(rounded(float(self), int(digits[1])), spec)


def measured() -> list[Path]:
    """Files of figures that a bench wrote for pages to quote."""
    return [path for path in FOLDER.glob("*.csv") if path != METRICS]


def figures() -> dict[str, SimpleNamespace]:
    """All recorded figures: by suite, and by their names in it."""
    suites = {path.stem: recorded(path.stem) for path in measured()}
    found = {
        suite: SimpleNamespace(**{name: Limit.of(name, value) for name, value in rows.items()})
        for suite, rows in suites.items()
    }
    return {**found, "palawan": _palawan(), "by_side": _by_side(recorded("sides"))}


def _by_side(measured: dict[str, float]) -> SimpleNamespace:
    """Of each case of `sides` the fuel west and east about, or "shut"; as `CASE_best` the side."""
    texts: dict[str, str] = {}
    for case in {name.rsplit("_", 1)[0] for name in measured if name.endswith("_west")}:
        fuel = {side: measured.get(f"{case}_{side}", math.inf) for side in ("west", "east")}
        shown = ["shut" if math.isinf(one) else _fuel(one) for one in fuel.values()]
        texts |= {case: ", ".join(shown), f"{case}_best": min(fuel, key=fuel.__getitem__)}
    return SimpleNamespace(**texts)


def _fuel(value: float) -> str:
    """Fuel with a digit behind the point, but for that at true scale."""
    return f"{value:.1f}" if value < 1e4 else f"{value:,.0f}"


def _palawan() -> SimpleNamespace:
    """The routes of palawan-season by season and rank."""
    with METRICS.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return SimpleNamespace(
        **{
            f"{row['season']}_{row['rank']}": SimpleNamespace(
                side=row["way"].split()[0],
                per_distance=float(row["fuel_per_distance"]),
                filled=Limit.of("filled", 100 * float(row["filled_share"])),
            )
            for row in rows
        }
    )


# A figure that needs a source: with a decimal point or a thousands separator, or a percentage.
FIGURE = re.compile(r"(?<![\w.:/-])\d+(?:[.,]\d+)+(?:e-\d+)?|(?<![\w.])\d+(?= %)")
OPTION = re.compile(r"--[a-z][a-z-]+")
RENEW = re.compile(r"(?:^|[\s`/])renew ((?:nightly |tide |qgis )?[a-z]+(?:-[a-z]+)*)\b([^\n#;|]*)")
DESIGN, NIGHT = "docs/explanation/design.md", "docs/how-to/nightly.md"
CLAIMS = "docs/explanation/claims.md"
PAGES = (*DOCUMENTS, "outputs/README.md")
# Options of other programs that pages name without the program.
FOREIGN = {"docs/how-to/operation.md": {"--collector.textfile.directory"}}
# Models of TOML files beside a scenario's, and their tables.
OTHER_MODELS: tuple[type[BaseModel], ...] = (
    VesselSpec,
    NightSpec,
    CaseSpec,
    DepartureSpec,
    EnvironmentSpec,
    Case,
    OwnStation,
    OwnConstant,
)
OTHER_TABLES = ("cases",)
# Names of files that a run or a night writes.
RESULT_FILE = re.compile(r"[a-z][\w-]*\.(?:html|gpkg|csv|json|nc|rtz|gpx|parquet|geojson|toml)")


def _text(document: str) -> str:
    """A document's text, its lines joined: a sentence may be wrapped anywhere."""
    return re.sub(r"\s+", " ", (ROOT / document).read_text("utf-8"))


@pytest.mark.parametrize("document", [page for page in QUOTES if "quoted" in QUOTES[page]])
def test_figures_are_those_that_a_bench_wrote(document: str) -> None:
    text, known = _text(document), figures()
    expected = [quoted.format(**known) for quoted in QUOTES[document]["quoted"]]
    missing = [quoted for quoted in expected if quoted not in text]
    assert missing == [], "as measured (docs/figures/), and so to be written on the page"


@pytest.mark.parametrize(
    ("name", "value", "spec", "written"),
    [
        ("bound", 83.90575572, ".2f", "83.90"),
        ("clearance", 8.938891635, ".1f", "8.9"),
        ("clearance", 8.999, ".2f", "8.99"),
        ("gap", 3.549803347, ".1f", "3.6"),
        ("unpadded_gap", 0.4526964329, ".1f", "0.5"),
        ("most_fuel", 1.000398416, ".4f", "1.0004"),
        ("most_bound", 0.9945403809, ".3f", "0.995"),
        ("worst", 3.170251115e-05, ".5f", "0.00004"),
        ("from_a_point", 33.8, ".0f", "34"),
        ("fuel", 86.88519292, ".2f", "86.89"),
    ],
)
def test_limits_are_written_on_their_safe_side(
    name: str, value: float, spec: str, written: str
) -> None:
    assert f"{Limit.of(name, value):{spec}}" == written


def test_no_limit_is_written_as_if_it_were_a_plain_figure() -> None:
    """Every figure behind such words on a page is a limit by its name."""
    words = r"(?:at most|at least|up to|no less than|less than|above|within) (?:the )?"
    texts = [one for page in QUOTES.values() for one in page.get("quoted", ())]
    named = [name for one in texts for name in re.findall(words + r"\{\w+\.(\w+):\.\d", one)]
    assert len(named) >= 5
    assert [name for name in named if Limit.of(name, 1.0).__class__ is float] == []


@pytest.mark.parametrize("document", [page for page in QUOTES if "given" in QUOTES[page]])
def test_no_figure_stands_there_without_a_source(document: str) -> None:
    """The given text is what is left without tables of runs, code and quoted texts."""
    text = (ROOT / document).read_text("utf-8")
    if BEGIN in text:
        before, rest = text.split(BEGIN)
        text = before + rest.split(END, 1)[1]
    text = re.sub(r"\s+", " ", re.sub(r"\]\([^)]*\)", "]", FENCE.sub("", text)))
    known = figures()
    for quoted in QUOTES[document].get("quoted", ()):
        text = text.replace(quoted.format(**known), "")
    given = {figure.removesuffix(" %") for figure in QUOTES[document]["given"]}
    found = {figure.rstrip(".,") for figure in FIGURE.findall(text)}
    versions = {figure for figure in found if re.fullmatch(r"3\.1\d|\d{4}\.\d{5}", figure)}
    assert found - versions <= given, "give it in tests/claims.toml, or better measure it"


def test_each_measured_figure_has_its_date_and_commit() -> None:
    for path in measured():
        assert path.stem in SUITES
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert rows
        for row in rows:
            assert tuple(row) == COLUMNS
            assert re.fullmatch(r"\d{4}-\d\d-\d\d", row["measured"])
            # Without the "+" of a program that was edited and not committed.
            assert re.fullmatch(r"[0-9a-f]{7,}", row["commit"]), path.name


def test_claims_name_suites_tests_and_dates_that_exist() -> None:
    text = _text(CLAIMS)
    suites = re.findall(r"`python -m tests\.bench ([a-z -]+)`", text)
    assert suites
    assert {name for names in suites for name in names.split()} <= SUITES.keys()
    for file, name in re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", text):
        assert f"def {name}(" in (ROOT / file).read_text("utf-8"), f"{file}::{name}"
    dates = {row["measured"] for path in measured() for row in _rows(path)}
    assert set(re.findall(r"\b20\d\d-\d\d-\d\d\b", text)) == dates


def _rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_options_of_plan_are_on_its_pages() -> None:
    signature = inspect.signature(renew.plan).parameters
    options = {one.name: one.default for one in dataclasses.fields(renew.PlanOptions)}
    assert set(options) == set(Changes.__annotations__)
    described = f"{inspect.getdoc(renew.plan)}\n{inspect.getdoc(renew.PlanOptions)}"
    listed = set(re.findall(r"^(\w+(?:, \w+)*) : ", described, re.MULTILINE))
    names = {*options, *signature} - {"changes"}
    assert names <= {name for names in listed for name in names.split(", ")}
    page = (ROOT / DESIGN).read_text("utf-8")
    example = re.search(r"plan = renew\.plan\((.*?)\n\)", page, re.DOTALL)
    assert example is not None
    shown = dict(re.findall(r"^    (\w+)=(.+),$", example[1], re.MULTILINE))
    defaults = options | {
        name: one.default for name, one in signature.items() if one.kind is one.KEYWORD_ONLY
    }
    del defaults["options"]
    assert {name: eval(value) for name, value in shown.items()} == defaults  # noqa: S307


@pytest.mark.parametrize("document", PAGES)
def test_commands_and_options_that_are_named_exist(document: str) -> None:
    commands = reference.commands()
    every = {"--help", "--version", "--install-completion", "--show-completion"}
    known = every.union(*(reference.options(one) for one in commands.values()))
    text = (ROOT / document).read_text("utf-8")
    shell = [block["body"] for block in FENCE.finditer(text) if block["language"] in SHELL]
    for typed in (*shell, *SPAN.findall(FENCE.sub("", text))):
        for name, rest in RENEW.findall(typed.replace("\\\n", " ")):
            if f"renew {name}" not in commands:
                name = name.split()[0]  # noqa: PLW2901  # of a command's argument
            command = commands.get(f"renew {name}")
            assert command is not None or name in {"nightly", "tide", "qgis"}, (
                f"no command: renew {name}"
            )
            if command is not None:
                unknown = set(OPTION.findall(rest)) - set(reference.options(command)) - every
                assert not unknown, f"renew {name} has no {unknown}"
    alone = {span.split()[0].split("=")[0] for span in SPAN.findall(text) if span.startswith("--")}
    assert alone - known <= FOREIGN.get(document, set())


@pytest.mark.parametrize("document", PAGES)
def test_files_of_results_that_are_named_exist(document: str) -> None:
    """Each is written by the pipeline, or is the repository's, or stands in the page's examples."""
    text = (ROOT / document).read_text("utf-8")
    examples = " ".join(block["body"] for block in FENCE.finditer(text))
    named = {span for span in SPAN.findall(FENCE.sub("", text)) if RESULT_FILE.fullmatch(span)}
    code = _writers()
    tables = {f"{name}.csv" for name in re.findall(r'Table\(\s*"([\w-]+)"', code)}
    named -= {name for name in named if f'"{name}"' in code or name in examples} | tables
    named -= {path.name for path in (*ROOT.iterdir(), *(ROOT / "catalog").rglob("*"))}
    assert named == set()


@cache
def _writers() -> str:
    """All code that writes results."""
    files = (path for room in ("pipeline", "experiments") for path in (ROOT / room).rglob("*.py"))
    return "".join(path.read_text("utf-8") for path in files)


def test_keys_of_a_night_are_on_their_page() -> None:
    page = (ROOT / NIGHT).read_text("utf-8")
    for model in (NightSpec, CaseSpec):
        missing = [name for name in model.model_fields if not re.search(rf"\b{name}\b", page)]
        assert missing == []


def _keys() -> dict[str, set[str]]:
    """Keys of a scenario's tables by their paths."""
    return {table.path: _names(table.model) for table in reference.tables()}


def _names(model: type[BaseModel]) -> set[str]:
    """Keys of a model as they are typed."""
    return {field.alias or name for name, field in model.model_fields.items()}


@pytest.mark.parametrize("document", PAGES)
def test_keys_that_are_named_exist(document: str) -> None:
    """Spans such as `planner.clearance` and `[chart]`, and all keys of TOML blocks."""
    tables = _keys()
    text = (ROOT / document).read_text("utf-8")
    for span in SPAN.findall(text):
        if re.fullmatch(r"\[\[?[a-z][a-z.]*\]?\]", span):
            assert span.strip("[]") in {*tables, *OTHER_TABLES}, span
        table, _, key = span.partition(".")
        if table in {"planner", "chart", "outputs", "region", "plane"} and key.isidentifier():
            assert key in tables[table], span
    known = set(CONSTITUENTS).union(*tables.values(), *map(_names, OTHER_MODELS))
    for block in FENCE.finditer(text):
        if block["language"] == "toml":
            named = set(_named(tomllib.loads(block["body"])))
            assert named <= known, f"no such keys: {named - known}"


def _named(value: object) -> Iterator[str]:
    """All keys of a TOML value, of tables inside it too."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from _named(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from _named(inner)
