"""What the night before left is damaged: the next one goes on, or names file and remedy."""

import json
import shutil
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline.errors import PipelineError
from pipeline.nightly.config import load_config
from pipeline.nightly.night import NightOutcome, run_night
from tests.pipeline.nightly.nights import REFERENCE, region_night, rows, write_forecast

_TABLES = ("cases.parquet", "history.parquet")
_OTHERS = ("routes.parquet", "routes.gpkg", "changes.csv", "index.html")


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-40])


def _flip(path: Path) -> None:
    """Change a byte in the middle, which no reader of the file's head or end meets."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


def _to_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


_DAMAGES: dict[str, Callable[[Path], None]] = {
    "empty": _empty,
    "cut": _cut,
    "flip": _flip,
    "gone": Path.unlink,
    "folder": _to_folder,
}


class Nights:
    """Two nights in a small region, and the forecasts of the third and later ones."""

    def __init__(self, folder: Path, cluster: str) -> None:
        self.file = region_night(folder, departures=1, workers=1)
        self.forecast = folder / "currents" / "m1.nc"
        self.start, self.output = folder / "start", folder / "out"
        self.cluster = cluster
        for day in (-2, -1):
            self.run(day, self.start)

    def run(self, day: int, output: Path | None = None) -> NightOutcome:
        """Run the night on the forecast of a day."""
        write_forecast(self.forecast, REFERENCE + timedelta(days=day), seed=day + 9)
        return run_night(load_config(self.file, output or self.output), scheduler=self.cluster)

    def begun(self) -> Path:
        """Return a fresh copy of what two nights left."""
        shutil.rmtree(self.output, ignore_errors=True)
        shutil.copytree(self.start, self.output, symlinks=True)
        return self.output

    def notes(self) -> list[str]:
        """Return the notes of the last cycle."""
        said = json.loads((self.output / "latest" / "night.json").read_text())
        return list(said["notes"])


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory, cluster: str) -> Nights:
    """Give two nights that went well."""
    return Nights(tmp_path_factory.mktemp("damage"), cluster)


def _history(output: Path) -> list[str]:
    return [row["cycle"] for row in rows(output, "history.parquet")]


def _check_next_night(nights: Nights, damaged: tuple[str, ...]) -> None:
    """Check that the cycle is whole, names what could not be read, and follows the night before."""
    output, outcome = nights.output, nights.run(0)
    assert (outcome.cycle, outcome.fresh) == ("2026-11-21T00Z", True)
    compared = "2026-11-19T00Z" if damaged else "2026-11-20T00Z"
    assert rows(output)[0]["earlier_cycle"] == compared
    kept = ["2026-11-19T00Z", *(() if damaged else ("2026-11-20T00Z",)), "2026-11-21T00Z"]
    assert _history(output) == kept
    assert len(nights.notes()) == len(damaged)
    if damaged:
        assert outcome.exit_code == 10
    for name in damaged:
        assert any(note.startswith(f"2026-11-20T00Z/{name} ") for note in nights.notes())


@pytest.mark.slow
def test_damaged_results_of_yesterday_are_noted_and_the_night_before_is_compared(
    nights: Nights,
) -> None:
    output = nights.begun()
    for name in _TABLES:
        _flip(output / "2026-11-20T00Z" / name)
    _check_next_night(nights, _TABLES)
    page = (output / "latest" / "index.html").read_text()
    assert "2026-11-20T00Z/cases.parquet is damaged" in page
    assert pq.read_table(output / "latest" / "history.parquet").num_rows == 2


@pytest.mark.slow
@pytest.mark.parametrize("damage", list(_DAMAGES))
@pytest.mark.parametrize("name", [*_TABLES, "night.json", *_OTHERS])
def test_each_kind_of_damage(nights: Nights, damage: str, name: str) -> None:
    """The next night goes on; the same night run again is planned anew, and whole."""
    output = nights.begun()
    _DAMAGES[damage](output / "2026-11-20T00Z" / name)
    _check_next_night(nights, () if name in _OTHERS else (name,))
    nights.begun()
    _DAMAGES[damage](output / "2026-11-20T00Z" / name)
    again = nights.run(-1)
    assert again.cycle == "2026-11-20T00Z-r2"
    assert nights.run(-1).message.startswith("nothing to do")


def _dangling(output: Path) -> None:
    (output / "latest").unlink()
    (output / "latest").symlink_to("2026-11-20T06Z")


def _real_folder(output: Path) -> None:
    (output / "latest").unlink()
    shutil.copytree(output / "2026-11-20T00Z", output / "latest")


def _file_in_place_of_link(output: Path) -> None:
    (output / "latest").unlink()
    (output / "latest").write_text("mine")


def _no_link(output: Path) -> None:
    (output / "latest").unlink()


def _folder_for_lock(output: Path) -> None:
    (output / ".nightly.lock").unlink()
    (output / ".nightly.lock").mkdir()


def _file_for_partial(output: Path) -> None:
    (output / "2026-11-21T00Z.partial").write_text("mine")


def _strange_partial(output: Path) -> None:
    partial = output / "2026-11-21T00Z.partial"
    (partial / "parts").mkdir(parents=True)
    (partial / "request.json").write_text("{")
    (partial / "parts" / "000000.part").write_bytes(b"PAR1")


def _damaged_store(output: Path) -> None:
    for path in output.glob(".artefacts/*/*.artefact"):
        _flip(path)


def _folder_of_tonight(output: Path) -> None:
    (output / "2026-11-21T00Z").mkdir()


_PLACES: dict[Callable[[Path], None], str] = {
    _dangling: "",
    _real_folder: "",
    _file_in_place_of_link: "",
    _no_link: "",
    _damaged_store: "",
    _strange_partial: "",
    _folder_of_tonight: "",
    _folder_for_lock: r"\.nightly\.lock: Is a directory; move away",
    _file_for_partial: r"\.partial: File exists; move away",
}


_QUICK = {_real_folder, _dangling, _damaged_store, _folder_for_lock}


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(one, marks=() if one in _QUICK else pytest.mark.slow, id=one.__name__)
        for one in _PLACES
    ],
)
def test_what_stands_in_the_way_is_set_aside_or_named(
    nights: Nights, spoil: Callable[[Path], None]
) -> None:
    output = nights.begun()
    spoil(output)
    if refused := _PLACES[spoil]:
        with pytest.raises(PipelineError, match=refused):
            nights.run(0)
        return
    outcome = nights.run(0)
    assert outcome.fresh
    assert outcome.cycle.startswith("2026-11-21T00Z")
    assert (output / "latest").resolve().name == outcome.cycle
    assert (output / "latest").is_symlink()
    assert _history(output) == ["2026-11-19T00Z", "2026-11-20T00Z", outcome.cycle]
