"""Nights with any fault are refused in some lines; all cases that can be planned are planned."""

import os
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from pipeline.scenario import catalogue
from tests.pipeline.nightly.nights import plane_night, region_night, write_forecast
from tests.robustness.limits import draw, number
from tests.robustness.renew_processes import NIGHT_CODES, Renew
from tests.robustness.test_scenario_files import oddly_encoded, with_faults, with_text_faults

_ODD_CELLS = (
    *("", " ", "nan", "inf", "-1e400", "1e308", "9" * 5000, "0x10", "1_0", "12,5", "'10'"),
    *('"', '"a\nb"', "\u0661\u0662", "\u202e", "x" * 3000, "-", "../x", "p0000", "10;50", "\t"),
)


def mutated_night(rng: random.Random, folder: Path) -> Path:
    """Write a night with faults to a new folder; return its file."""
    kind = rng.random()
    if kind < 0.2:
        folder.mkdir(parents=True)
        file = folder / "night.toml"
        file.write_bytes((catalogue.root() / "nightly.toml").read_bytes())
    elif kind < 0.5:
        file = region_night(folder)
        if rng.random() < 0.5:
            write_forecast(folder / "currents" / "one.nc")
        file.write_text(file.read_text() + 'pairs = "pairs.csv"\n')
        head = "start_lon,start_lat,goal_lon,goal_lat,name\n"
        (folder / "pairs.csv").write_text(head + "118.40,10.20,118.60,10.30,here\n")
    else:
        file = plane_night(folder, pairs=rng.choice((1, 6, 6, 40)))
    changes: list[Callable[[random.Random, Path], None]] = [_change_night]
    if rng.random() < 0.15:
        changes = [_change_gently]
    elif kind >= 0.2:
        changes += [_change_pairs, _change_scenario]
    for change in rng.sample(changes, rng.choice((1, 1, 2, 2)) if len(changes) > 1 else 1):
        change(rng, folder)
    return file


def _change_gently(rng: random.Random, folder: Path) -> None:
    """Give the night's keys other values that they may have."""
    file = folder / "night.toml"
    likely = {
        "keep": (1, 100_000),
        "limit_hours": (1e-9, 0.02, 1000),
        "look_percent": (0, 1e300),
        "stale_hours": (1e-300, 1e6),
        "workers": (1, 2),
        "memory_gb": (0.5, 1.0, 1e308),
        "output": ('"out"', '"./a/../b"', '"x y"', '"out\\n"', '"船"'),
    }
    text = file.read_text("utf-8")
    for key in rng.sample(sorted(likely), 3):
        if f"{key} =" not in text:
            text = f"{key} = {rng.choice(likely[key])}\n{text}"
    file.write_text(text, encoding="utf-8")


def _change_night(rng: random.Random, folder: Path) -> None:
    """Make faults in the night's file."""
    file = folder / "night.toml"
    content = file.read_bytes()
    content = oddly_encoded(rng, content) if rng.random() < 0.1 else with_faults(rng, content)
    file.write_bytes(content)


def _change_scenario(rng: random.Random, folder: Path) -> None:
    """Make faults in the scenario's file."""
    file = next(path for path in folder.glob("*.toml") if path.name != "night.toml")
    file.write_bytes(with_faults(rng, file.read_bytes()))


def _change_pairs(rng: random.Random, folder: Path) -> None:
    """Make faults in the pairs: in cells, rows and columns, in bytes, or in what the file is."""
    file = folder / "pairs.csv"
    content = file.read_bytes()
    kind = rng.random()
    if kind < 0.25:
        file.write_bytes(with_text_faults(rng, content))
    elif kind < 0.35:
        file.write_bytes(oddly_encoded(rng, content))
    elif kind < 0.42:
        file.unlink()
        rng.choice(
            (
                file.mkdir,
                lambda: file.symlink_to("/dev/zero"),
                lambda: file.symlink_to(file.name),
                lambda: os.mkfifo(file),
                lambda: file.write_bytes(b""),
                lambda: file.write_bytes(content.splitlines()[0]),
                lambda: None,
            )
        )()
    else:
        rows = [line.split(",") for line in content.decode().splitlines()]
        for _ in range(rng.choice((1, 1, 2, 5))):
            _change_rows(rng, rows)
        file.write_text("\n".join(map(",".join, rows)), encoding="utf-8")


def _change_rows(rng: random.Random, rows: list[list[str]]) -> None:
    """Make one fault in rows of cells."""
    row = rng.choice(rows)
    at = rng.randrange(len(row)) if row else 0
    changes: tuple[Callable[[], object], ...] = (
        lambda: row.__setitem__(at, rng.choice(_ODD_CELLS)),
        lambda: row.__setitem__(at, rng.choice(_ODD_CELLS)),
        lambda: row.pop(at),
        lambda: row.insert(at, rng.choice(_ODD_CELLS)),
        row.reverse,
        lambda: rows.append(list(row)),
        lambda: rows.extend([list(row)] * rng.choice((2, 3000))),
        lambda: rows.insert(rng.randrange(len(rows)), []),
        rows.reverse,
    )
    if row:
        rng.choice(changes)()


SAMPLE = 20
# One night in this many is also run: of those with faults, and of those without.
_RUN_FAULTY, _RUN_VALID = 10, 40
_REFUSED = 2


def failures(folder: Path, cases: range, renew: Renew) -> list[str]:
    """Check mutated nights, and run some of them; describe what went wrong."""
    found = []
    for case in cases:
        rng = draw("nights", case)
        place = folder / str(case)
        file = mutated_night(rng, place)
        checked = renew(["nightly", "check", "--config", str(file)], place)
        why = checked.fault()
        is_faulty = checked.exit_code == _REFUSED
        if not why and case % (_RUN_FAULTY if is_faulty else _RUN_VALID) == 0:
            command = ["nightly", "run", "--config", str(file), "--output", "out"]
            ran = renew(command, place)
            why = ran.fault(NIGHT_CODES)
            if not why and is_faulty and ran.exit_code != _REFUSED:
                why = f"refused by check, and then run: exit code {ran.exit_code}"
        if why:
            found.append(f"night {case}: {why}")
        shutil.rmtree(place)
    return found


def test_a_sample_of_faulty_nights(tmp_path: Path) -> None:
    met = set()
    for case in range(SAMPLE):
        file = mutated_night(draw("nights", case), tmp_path / str(case))
        arguments = ["nightly", "check", "--config", str(file)]
        met.add(CliRunner().invoke(app, arguments, catch_exceptions=False).exit_code)
    assert met == {0, _REFUSED}


@pytest.mark.slow
def test_many_faulty_nights(tmp_path: Path) -> None:
    nights = number("nights", 200)
    with Renew() as renew:
        found = failures(tmp_path, range(nights), renew)
        print(f"{nights} nights: {dict(renew.met)}")  # noqa: T201
        assert not found, "\n".join(found)
        assert renew.met["exit 0"] > nights / 20
        assert renew.met["exit 2"] > nights / 2
