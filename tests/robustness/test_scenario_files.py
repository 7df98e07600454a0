"""Scenario files with any fault are refused with a RequestError, and never end in a traceback."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from pipeline.errors import RequestError
from pipeline.loading import load_scenario
from tests.robustness.limits import TooSlowError, cpu_limit, failure
from tests.robustness.scenario_files import mutated

if TYPE_CHECKING:
    from pathlib import Path

SEED = 20_260_111
FILES = 10_000
SAMPLE = 200


def outcomes(folder: Path, cases: range) -> tuple[list[str], int, int]:
    """Load mutated files: descriptions of failures, and how many were valid and refused."""
    failures: list[str] = []
    valid = refused = 0
    path = folder / "mutated.toml"
    for case in cases:
        path.write_bytes(mutated(random.Random(f"{SEED} {case}")))  # noqa: S311 - a test's seed
        try:
            with cpu_limit():
                load_scenario(str(path))
            valid += 1
        except RequestError as error:
            refused += 1
            if not all(fault.strip() for fault in error.faults) or not error.faults:
                failures.append(f"case {case}: a fault without words: {error.faults}")
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - what must not happen
            failures.append(failure(case, error))
    return failures, valid, refused


def test_a_sample_of_faulty_files_is_refused(tmp_path: Path) -> None:
    failures, valid, refused = outcomes(tmp_path, range(SAMPLE))
    assert not failures, "\n".join(failures)
    assert refused > valid > 0


@pytest.mark.slow
def test_ten_thousand_faulty_files_are_refused(tmp_path: Path) -> None:
    failures, valid, refused = outcomes(tmp_path, range(FILES))
    assert not failures, "\n".join(failures)
    assert refused > valid > 100
