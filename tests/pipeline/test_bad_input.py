"""Bad input gets one-line errors with value and remedy, exit code 2, and nothing is written."""

import re
import time
import tomllib
from pathlib import Path

import pytest
import shapely
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.scenario.loading import load_scenario
from pipeline.sources.land import osm
from tests.pipeline.conftest import ACROSS_BOX
from tests.pipeline.small_plane import small_plane
from tests.pipeline.small_region import small_region

# A region across the middle of Palawan: the island divides it from edge to edge.
ACROSS = (
    small_region("across")
    + """[chart]
tolerance_m = 500
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["embedded-palawan"]
[planner]
classes = 2
"""
)
PLANE = small_plane("plain", classes=2)


def run(folder: Path, text: str, output: Path | None = None) -> tuple[int, list[str]]:
    """Return exit code and error lines of `renew run` for a scenario's text."""
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return run_at(folder, str(path), output)


def run_at(folder: Path, asked: str, output: Path | None = None) -> tuple[int, list[str]]:
    """Return exit code and error lines of `renew run`; check what it left."""
    output = output or folder / "outputs"
    arguments = ["run", asked, "--output", str(output)]
    before = set(output.glob("[!.]*"))
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    if result.exit_code == 2:
        assert set(output.glob("[!.]*")) == before, "a wrong request must leave no results"
        assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    return result.exit_code, lines


def only(code_and_lines: tuple[int, list[str]]) -> str:
    """Return the only error line of a refused request."""
    code, lines = code_and_lines
    assert code == 2
    assert len(lines) == 1, lines
    return lines[0]


def with_line(text: str, old: str, new: str) -> str:
    """Replace a text that occurs exactly once."""
    assert text.count(old) == 1
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("classes = 2", "clases = 2", ["planner.clases", "did you mean 'classes'"]),
        ("classes = 2", "classes = 0", ["planner.classes = 0", "below 1", "such as 16"]),
        ("classes = 2", "risk = 0", ["planner.risk = 0", "below 1e-09", "0.05"]),
        ("classes = 2", "classes = 10001", ["classes = 10001", "above 10,000", "to 10,000"]),
        ("classes = 2", "samples = 1000001", ["samples = 1000001", "above 1,000,000"]),
        ("classes = 2", "risk = 9e-10", ["risk = 9e-10", "below 1e-09"]),
        (
            'vessel = "paper-asv"',
            "vessel = {length_m = 1e7, speed_m_s = 1, turn_rate_deg_s = 1}",
            ["vessel.length_m = 10000000.0", "above 600", "in metres"],
        ),
        (
            'vessel = "paper-asv"',
            "vessel = {length_m = 1, speed_m_s = 1, turn_rate_deg_s = 1, fuel_exponent = 21}",
            ["vessel.fuel_exponent = 21", "above 20", "2 is the paper's"],
        ),
        ("classes = 2", "risk = 1", ["planner.risk = 1", "not below 1", "0.05"]),
        ("classes = 2", "risk = nan", ["planner.risk", "not finite", "0.05"]),
        ("classes = 2", 'risk = "low"', ['planner.risk = "low"', "not a number", "0.05"]),
        (
            "classes = 2",
            "padding = -1",
            ["planner.padding = -1", "'adaptive', 'triangle', 'none' or metres"],
        ),
        ("scale = 1000", "scale = 0", ["scale = 0", "below 0.1", "1 is the true scale"]),
        ("scale = 1000", "colour = 1", ["unknown key colour", "start"]),
        (
            "schema_version = 1",
            "schema_version = 9",
            ["schema_version = 9", "write schema_version"],
        ),
        ("paper-asv", "paper-avs", ["vessel", "paper-avs", "did you mean 'paper-asv'"]),
        ("embedded-palawan", "embeded-palawan", ["seasons[0].currents[0]", "'embedded-palawan'"]),
        ('"summer"', '"sumer"', ["'sumer': did you mean 'summer'? summer is of the months 6, 7"]),
        ('"2024-07"', '"July"', ["seasons[0].valid = 'July' is not a time", "YYYY-MM-DDTHH:MMZ"]),
        ('"2024-07"', '"2024-02-30"', ["seasons[0].valid = '2024-02-30'", "is not a time (day "]),
        ("valid =", 'time_method = "median"\nvalid =', ['time_method = "median"', "'nearest'"]),
        ("goal = [118.60, 10.30]", "", ["goal is missing", "[lon, lat]"]),
        ("goal = [118.60, 10.30]", "goal = [10.3, 118.6]", ["not a place on earth", "[longitude"]),
        (
            "goal = [118.60, 10.30]",
            "goal = [118.6, 12]",
            ["goal = [118.6, 12.0]", "177 km outside the region", "move it inside"],
        ),
        (
            "bbox = [118.3, 9.3, 119.2, 10.4]",
            "polygon = [[118.3, 9.3], [119.2, 10.4], [119.2, 9.3], [118.3, 10.4]]",
            ["region.polygon", "crosses itself at 118.75, 9.85", "order round the edge"],
        ),
        (
            "bbox = [118.3, 9.3, 119.2, 10.4]",
            "bbox = [119.2, 9.3, 118.3, 10.4]",
            ["region has bbox", "west must be below east"],
        ),
        (
            "bbox = [118.3, 9.3, 119.2, 10.4]",
            "bbox = [118.3, 3.5, 123.9, 10.4]",
            ["no data south of 6.75 (the region reaches 3.5) nor east of 123.25", "smaller region"],
        ),
    ],
)
def test_one_fault_gets_one_line_with_value_and_remedy(
    tmp_path: Path, old: str, new: str, said: list[str]
) -> None:
    line = only(run(tmp_path, with_line(ACROSS, old, new)))
    for words in said:
        assert words in line


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("u = 0.1", "u = -101", ["uniform.u = -101", "below -100", "at most 100"]),
        ("uniform = { u = 0.1 }", "gyre = { amplitude = 1e9 }", ["gyre.amplitude", "above 100"]),
        (
            "extent = [0, 0, 100, 100]",
            "extent = [0, 0, 100, 2000001]",
            ["plane has extent", "2,000 km wide", "shrink it"],
        ),
        (
            "extent = [0, 0, 100, 100]",
            "extent = [0, 49.99999, 100, 50]",
            ["plane has extent", "1e-05 m across", "at least a millionth"],
        ),
        ("[plane]", "scale = 20001\n[plane]", ["2,000 true km", "lower scale"]),
        ("[plane]", "scale = 0.09\n[plane]", ["scale = 0.09", "below 0.1", "1 is the true"]),
    ],
)
def test_a_plane_beyond_its_limits(tmp_path: Path, old: str, new: str, said: list[str]) -> None:
    line = only(run(tmp_path, with_line(PLANE, old, new)))
    for words in said:
        assert words in line


def test_marks_of_direction_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "marked.toml"
    marks = "\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
    title = f'title = "ab{marks}\\u202Ec"\n'
    path.write_text(title + PLANE, encoding="utf-8")
    assert load_scenario(str(path)).title == "abc"


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    places = with_line(ACROSS, "[118.40, 10.20]", "[100, 10.20]")
    places = with_line(places, 'currents = ["embedded-palawan"]', 'currents = ["osm-land"]')
    keys = with_line(places, "classes = 2", "clases = 2\nrisk = 2\nseed = -1")
    keys = with_line(keys, "paper-asv", "titanic")
    # Faults of keys come first; those between tables are reported once all keys are valid.
    for text, said in (
        (keys, ("clases", "risk = 2", "seed = -1", "titanic")),
        (places, ("start = [100.0, 10.2] lies 2", "gives land, not currents")),
    ):
        code, lines = run(tmp_path, text)
        assert code == 2
        for words in said:
            assert sum(words in line for line in lines) == 1, words
        assert len(lines) == len(said)


def test_check_says_at_once_what_currents_and_land_lack(tmp_path: Path) -> None:
    text = with_line(ACROSS, "[118.3, 9.3, 119.2, 10.4]", "[118.3, 3.5, 123.9, 10.4]")
    path = tmp_path / "scenario.toml"
    path.write_text(with_line(text, "[118.40, 10.20]", "[118.70, 9.85]"), encoding="utf-8")
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 2
    currents, land = result.stderr.splitlines()
    assert "season 'summer': embedded-palawan has no data south of 6.75" in currents
    assert "start = [118.7, 9.85] lies on land" in land


def test_start_on_land_says_how_far_and_where_water_is(
    tmp_path: Path, across_outputs: Path
) -> None:
    text = with_line(ACROSS, "[118.40, 10.20]", "[118.70, 9.85]")
    line = only(run(tmp_path, text, across_outputs))
    assert "start = [118.7, 9.85] lies on land" in line
    found = re.search(
        r"([\d.]+) km from the nearest water with a way out at \[([\d.]+), ([\d.]+)\]", line
    )
    assert found is not None
    away_km, lon, lat = (float(number) for number in found.groups())
    # The suggested place is water on the original chart, and a start from there is accepted.
    land = shapely.union_all(osm.OsmLand().land(shapely.box(*ACROSS_BOX)).polygons)
    assert not land.intersects(shapely.Point(lon, lat))
    # On a sphere, with the latitude's cosine: not how the pipeline measures.
    degrees = land.boundary.distance(shapely.Point(118.70, 9.85))
    assert degrees * 111.2 * 0.98 <= away_km + 0.1
    assert away_km < 40
    moved = with_line(text, "[118.70, 9.85]", f"[{lon}, {lat}]")
    code, lines = run(tmp_path, with_line(moved, "across", "moved"), across_outputs)
    assert not any("start" in line and "land" in line for line in lines), (code, lines)


def test_goal_in_another_body_of_water(tmp_path: Path, across_outputs: Path) -> None:
    text = with_line(ACROSS, "[118.60, 10.30]", "[119.10, 9.40]")
    line = only(run(tmp_path, text, across_outputs))
    assert "goal = [119.1, 9.4] lies in another body of water than start = [118.4, 10.2]" in line
    found = re.search(
        r"joins the (start|goal) is [\d.]+ km from the (goal|start), at (\[[\d., ]+\]); move the "
        r"(goal|start) there, or in a scenario widen",
        line,
    )
    assert found is not None
    kept, moved, place, there = found.groups()
    assert moved == there != kept
    stop = {"start": "[118.40, 10.20]", "goal": "[119.10, 9.40]"}[moved]
    followed = with_line(with_line(text, stop, place), "across", "followed")
    code, lines = run(tmp_path, followed, across_outputs)
    assert not any("another body" in line for line in lines), (code, lines)


def test_overpowering_current_at_the_start(tmp_path: Path) -> None:
    line = only(run(tmp_path, with_line(PLANE, "u = 0.1", "u = 1.5")))
    assert "1.5 m/s" in line
    assert "1 m/s" in line
    assert "faster vessel or another start" in line


def test_obstacles_that_leave_no_water(tmp_path: Path) -> None:
    everything = "[[0, 0], [100, 0], [100, 100], [0, 100]]"
    old = "[[40, 30], [60, 30], [60, 70], [40, 70]]"
    assert "no water is left" in only(run(tmp_path, with_line(PLANE, old, everything)))


@pytest.mark.usefixtures("plain_report")
def test_a_failed_season_exits_with_1_and_the_other_is_written(tmp_path: Path) -> None:
    seasons = "uniform = { u = 0.1 }\n[[seasons]]\nname = 'storm'\nuniform = { v = 2.0 }"
    code, lines = run(tmp_path, with_line(PLANE, "uniform = { u = 0.1 }", seasons))
    assert code == 1
    assert len(lines) == 1
    assert "'storm'" in lines[0]
    assert "2 m/s" in lines[0]
    assert (tmp_path / "outputs" / "plain" / "metrics.csv").read_text().count("still") >= 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"start: [1, 2]\n", ["not TOML", "renew show palawan-season"]),
        (b"\xff\xfe\x00", ["not text", "TOML"]),
        (b"", ["not a scenario", "renew show palawan-season"]),
        (b"[project]\nname = 'x'\n", ["not a scenario", "renew show palawan-season"]),
    ],
)
def test_files_that_are_not_scenarios(tmp_path: Path, content: bytes, said: list[str]) -> None:
    path = tmp_path / "thing.toml"
    path.write_bytes(content)
    line = only(run_at(tmp_path, str(path)))
    for words in ["thing.toml", *said]:
        assert words in line


def test_what_is_too_large_for_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "large.toml"
    path.write_text(PLANE + "# a comment\n" * 400_000)
    assert "has 4 MB, more than 4: too much for a request" in only(run_at(tmp_path, str(path)))
    season = '[[seasons]]\nname = "s"\nuniform = { u = 0.1 }\n'
    path.write_text(PLANE + season * 60_000)
    began = time.process_time()
    code, lines = run_at(tmp_path, str(path))
    assert code == 2
    assert len(lines) < 10
    assert "has 60,001 items, not 1,000" in "\n".join(lines)
    assert time.process_time() - began < 30


def test_a_directory_a_missing_file_an_unknown_name(tmp_path: Path) -> None:
    assert "is a directory" in only(run_at(tmp_path, str(tmp_path)))
    missing = only(run_at(tmp_path, str(tmp_path / "palawan-sesaon.toml")))
    assert "no such file" in missing
    assert "did you mean 'palawan-season'?" in missing
    assert "did you mean 'single-gyre'?" in only(run_at(tmp_path, "singel-gyre"))


def test_these_scenarios_are_valid_but_for_what_a_test_changes(tmp_path: Path) -> None:
    for text in (ACROSS, PLANE):
        assert tomllib.loads(text)
        path = tmp_path / "valid.toml"
        path.write_text(text, encoding="utf-8")
        result = CliRunner().invoke(app, ["check", str(path)])
        assert result.exit_code == 0, result.output
