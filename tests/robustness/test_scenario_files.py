"""Scenario files with any fault are refused in some lines, and never end in a traceback."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.scenario.loading import load_scenario
from tests.robustness.campaign import draw, number
from tests.robustness.limits import TooSlowError, cpu_limit, failure
from tests.robustness.renew_processes import MAX_LINE, MAX_LINES, Renew
from tests.robustness.scenario_files import mutated

SAMPLE = 200


def outcomes(folder: Path, cases: range, renew: Renew | None = None) -> tuple[list[str], int, int]:
    """Load mutated files: descriptions of failures, and how many were valid and refused.

    What is valid is also checked by the command line, where there is one to do so.
    """
    failures: list[str] = []
    valid = refused = 0
    path = folder / "mutated.toml"
    for case in cases:
        path.write_bytes(mutated(draw("scenarios", case)))
        try:
            with cpu_limit():
                load_scenario(str(path))
            valid += 1
            why = "" if renew is None else renew(["check", str(path)], folder).fault()
            failures += [f"case {case}: {why}"] if why else []
        except RequestError as error:
            refused += 1
            failures += [f"case {case}: {why}" for why in _faults_of(error)]
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - what must not happen
            failures.append(failure(case, error))
    return failures, valid, refused


def _faults_of(error: RequestError) -> Iterator[str]:
    """Say what is wrong with the faults of an error."""
    if not all(fault.strip() for fault in error.faults) or not error.faults:
        yield f"a fault without words: {error.faults}"
    if len(error.faults) > MAX_LINES:
        yield f"{len(error.faults)} faults"
    longest = max(error.faults, key=len)
    if len(longest) > MAX_LINE:
        yield f"a fault of {len(longest)} characters: {longest}"


def test_a_sample_of_faulty_files_is_refused(tmp_path: Path) -> None:
    failures, valid, refused = outcomes(tmp_path, range(SAMPLE))
    assert not failures, "\n".join(failures)
    assert refused > valid > 0


@pytest.mark.slow
def test_many_faulty_files_are_refused(tmp_path: Path) -> None:
    files = number("scenarios", 2000)
    with Renew() as renew:
        failures, valid, refused = outcomes(tmp_path, range(files), renew)
        print(f"{files} scenarios: {refused} refused, {valid} valid: {dict(renew.met)}")  # noqa: T201
    assert not failures, "\n".join(failures)
    assert refused > valid > files / 100
