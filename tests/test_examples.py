"""The gate draws the same examples for everybody; `make test-new-examples` draws others."""

import os
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.commands import ran

# Two property tests that record their examples. Hypothesis would take the constants of a module
# beside them for interesting numbers, once that is imported.
TESTS = """
import os
import pytest
from hypothesis import given, settings, strategies as st
if os.environ.get("IMPORT"):
    import beside

@pytest.mark.parametrize("name", ["one", "other"])
@settings(max_examples=60)
@given(number=st.floats(), count=st.integers())
def test_that_notes_its_examples(name, number, count):
    with open(os.environ["NOTES"], "a") as notes:
        notes.write(f"{name} {number!r} {count}\\n")
"""


def drawn(root: Path, folder: Path, *options: str, **variables: str) -> Counter[str]:
    """Run the tests with options in a process of its own: the examples that they note."""
    notes, tests = folder / "notes", folder / "test_noting.py"
    tests.write_text(TESTS)
    (folder / "beside.py").write_text("FIGURES = [2.71828, 31.4159, 141421, 161803]\n")
    notes.unlink(missing_ok=True)
    environment = {key: value for key, value in os.environ.items() if key != "CI"} | variables
    plugins = ("-p", "_hypothesis_pytestplugin", "-p", "tests.conftest")
    asked = ("-q", *plugins, "--rootdir", str(folder), "-c", os.devnull, *options)
    ran(
        sys.executable,
        "-m",
        "pytest",
        *asked,
        str(tests),
        cwd=root,
        env=environment | {"NOTES": str(notes), "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
    )
    return Counter(notes.read_text().splitlines())


def of_other(examples: Counter[str]) -> Counter[str]:
    """Examples of the second test."""
    return Counter({one: count for one, count in examples.items() if one.startswith("other ")})


def test_examples_depend_on_neither_ci_nor_order_nor_what_is_imported(
    root: Path, tmp_path: Path
) -> None:
    alone = of_other(drawn(root, tmp_path))
    among = drawn(root, tmp_path, "-k", "other", CI="true", IMPORT="yes")
    assert alone.total() >= 60
    assert among == alone


@pytest.mark.slow
def test_new_examples_are_those_of_their_seed(root: Path, tmp_path: Path) -> None:
    new = "--hypothesis-profile=new-examples"
    gate = drawn(root, tmp_path)
    first = drawn(root, tmp_path, new, "--hypothesis-seed=1")
    assert drawn(root, tmp_path, new, "--hypothesis-seed=1", IMPORT="yes") == first
    assert first not in (gate, drawn(root, tmp_path, new, "--hypothesis-seed=2"))
