"""Files on which the HDF5 library hangs or crashes are found in a process of their own."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.machine.interpreters import run_python
from pipeline.sources.cf import dataset as probing
from tests.pipeline.sources.cf.sample_files import SEA
from tests.pipeline.synthetic_currents import dataset, write

# Stands in for the probe: does to each file what the file's name says.
STAND_IN = """
import os, signal, sys, time
for i, name in enumerate(sys.stdin.read().splitlines()[1:]):
    print(i, file=sys.stderr, flush=True)
    if "hang" in name:
        time.sleep(60)
    if "crash" in name:
        os.kill(os.getpid(), signal.SIGSEGV)
"""


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Put a script in the probe's place: no file is known to crash every version of a library."""
    script = tmp_path / "stand_in.py"
    script.write_text(STAND_IN)
    run = run_python

    def run_script(arguments: list[str], stdin: str, deadline_s: float) -> object:
        assert arguments == ["-m", "pipeline.sources.cf.dataset"]
        return run([str(script)], stdin, deadline_s)

    monkeypatch.setattr(probing, "run_python", run_script)
    monkeypatch.setattr(probing, "_START_S", 1.0)
    monkeypatch.setattr(probing, "_FILE_S", 0.1)


@pytest.mark.usefixtures("stand_in")
def test_each_fatal_file_is_named_and_the_others_are_not(tmp_path: Path) -> None:
    names = ("a.nc", "crash.nc", "b.nc", "hang.nc", "crash-too.nc", "c.nc")
    files = [tmp_path / name for name in names]
    for file in files:
        file.write_bytes(b"\x89HDF")
    found = probing.fatal_files(files)
    assert [file.name for file in found] == ["crash.nc", "hang.nc", "crash-too.nc"]
    assert "the HDF5 library ends by SIGSEGV on it" in found[files[1]]
    assert "the HDF5 library hangs on it; fetch it again" in found[files[3]]


def test_whole_and_cut_files_are_left_to_the_reader(tmp_path: Path) -> None:
    whole = write(tmp_path / "whole.nc", dataset(SEA))
    cut = tmp_path / "cut.nc"
    cut.write_bytes(whole.read_bytes()[:5000])
    assert probing.fatal_files([whole, cut]) == {}
