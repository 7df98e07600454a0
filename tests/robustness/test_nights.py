"""Nights with any fault are refused in some lines; all cases that can be planned are planned."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.main import app
from tests.robustness.campaign import draw, number
from tests.robustness.night_files import mutated_night
from tests.robustness.renew_processes import NIGHT_CODES, Renew

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
