"""Faults are printed in a limited number of lines of limited length, however many they are."""

import pickle

from pipeline.errors import Fault, RequestError, StageError
from pipeline.scenario.strict import near_miss


def test_similar_faults_are_reported_once_with_their_places() -> None:
    after = ".valid = 'July' is not a time; give YYYY-MM"
    faults = [Fault(f"seasons[{i}]", after) for i in range(50)]
    said = RequestError([*faults, "start is missing"]).faults
    assert said == (
        (
            "seasons[0].valid = 'July' is not a time; give YYYY-MM "
            "(the same in seasons[1], seasons[2], seasons[3] and 46 more)"
        ),
        "start is missing",
    )
    rows = [Fault(f"row {i}", ": has 1 cells", "pairs.csv, ") for i in range(2, 6)]
    rows = [row.behind("night.toml, line 4: ") for row in rows]
    assert RequestError(rows).faults == (f"{rows[0]} (the same in row 3, row 4, row 5)",)


def test_few_faults_stay_lines_of_their_own() -> None:
    faults = [f"seasons[{i}].valid is missing" for i in range(3)]
    assert RequestError([*faults, faults[0]]).faults == tuple(faults)


def test_what_is_too_many_is_counted() -> None:
    faults = [f"row {i}: name = 'p{i}' is no name" for i in range(2449)]
    said = RequestError(faults).faults
    assert len(said) == 40
    assert said[38:] == (faults[38], "and 2,410 more faults; mend these first")[-2:]


def test_long_faults_keep_their_place_and_their_remedy() -> None:
    (said,) = RequestError([f"--only = {'x' * 5000!r} is no case; give its name"]).faults
    assert said.startswith("--only = 'xxx")
    assert said.endswith("xxx' is no case; give its name")
    assert len(said) < 250
    (said,) = RequestError([f"--only = {'x y ' * 2000!r} is no case; give its name"]).faults
    assert said.startswith("--only = 'x y")
    assert said.endswith("x y ' is no case; give its name")
    assert len(said) == 800
    (line,) = str(StageError(f"{'a' * 900}; free some space")).splitlines()
    assert line.endswith("; free some space")
    assert len(line) < 250


def test_a_fault_is_pickled_as_it_is() -> None:
    error = RequestError([f"seasons[{i}] is wrong" for i in range(9)])
    assert pickle.loads(pickle.dumps(error)).faults == error.faults  # noqa: S301 - our own


def test_many_names_are_listed_in_part() -> None:
    assert near_miss("zzz", ["b", "a"]) == "choose from a, b"
    assert near_miss("zzz", ["a" * 300]) == f"choose from {'a' * 300}"
    said = near_miss("zzz", [f"name-{i:03}" for i in range(100)])
    assert said.startswith("choose from name-000, name-001, ")
    assert said.endswith("name-022, name-023 and 76 more")
