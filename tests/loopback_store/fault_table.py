"""The fault table: each way in which the service and its client were seen to fail, injected.

A row says what goes wrong, and what the message must contain.
"""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pipeline.errors import StageError
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.sources.copernicus.adapter import Copernicus
from pipeline.sources.copernicus.client import PASSWORD, USERNAME
from pipeline.sources.copernicus.download import step_ends
from tests.loopback_store import world
from tests.loopback_store.server import LOGIN, Fault, LoopbackStore

DAILY, TOTAL = "copernicus-forecast-daily", "copernicus-total-hourly"
# Largest error of a single cell that can't be detected, m/s: see `_SPIKE_M_S` in
# `pipeline.sources.copernicus.adapter`.
_UNDETECTED_M_S = 0.4


@dataclass(frozen=True)
class Row:
    """One fault: how it is injected, and the parts of the message that it must cause.

    Without a message the field must be downloaded, with errors up to `tolerance_m_s`.
    `spec_changes` are those of the catalogue's entry, `dataset` are options of the store's dataset;
    `kill` ends the first client, and `prepare` is called with the downloads' folder before.
    """

    name: str
    message: tuple[str, ...]
    faults: tuple[Fault, ...] = ()
    source: str = DAILY
    valid: str = "2024-10-05"
    deadline_s: float = 60.0
    spec_changes: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    dataset: dict[str, Any] = field(default_factory=dict)
    kill: signal.Signals | None = None
    prepare: Callable[[Path], None] | None = None
    tolerance_m_s: float = world.TOLERANCE_M_S
    is_quick: bool = False

    def entry(self) -> CopernicusSpec:
        """Return the dataset's entry with a short deadline, and one attempt unless changed."""
        fast = {"deadline_s": self.deadline_s, "attempts": 1, "pause_s": 0.0}
        return world.spec(self.source).model_copy(update={**fast, **self.spec_changes})


def _garbage(folder: Path) -> None:
    """Put garbage where the file will be cached, and its sidecar."""
    for suffix in ("nc", "json"):
        for name in (f"{world.spec(DAILY).dataset}_2024-10-05", _cached_stem()):
            (folder / f"{name}.{suffix}").write_bytes(b"garbage")


def _cached_stem() -> str:
    """Return the name under which the daily field is cached."""
    source, season = Copernicus(world.spec(DAILY)), world.season("2024-10-05")
    asked = source.asked(world.REGION, season)
    return source.cached_file(asked, season, Path()).stem


def _killed_run(folder: Path) -> None:
    """Leave the staging folder of a run that was killed long ago, with the client's file in it."""
    staging = folder / "tmp0123abcd.partial"
    staging.mkdir()
    (staging / f"{_cached_stem()}.nc.k3x9_q2z").write_bytes(b"half a file")
    os.utime(staging, (0, 0))


# The region needs nine chunks, rows 32-34 and columns 111-113; (33, 112) is all island, and of the
# last column the region has only one line of cells.
_ANY, _ONE, _EDGE, _TIME = "*/uo/*", "*/uo/*.34.111", "*/?o/*.34.113", "*.zarr/time/0"

# Bits of a float32: the sign, the highest of the exponent, the highest of the fraction.
_SIGN, _HIGH, _LOW = 31, 30, 22


def _cell_bit(bit: int) -> int:
    """Return the number of a bit in a cell of `_ONE`, inside the region, with 0.3 m/s."""
    return 32 * (32 * 16 + 31) + bit


ROWS: tuple[Row, ...] = (
    Row("nothing goes wrong", ()),
    Row(
        "a chunk answers 404",
        ("had no data for", "cells of water"),
        (Fault(_ONE, 404),),
        is_quick=True,
    ),
    Row("a chunk answers 403", ("had no data for", "cells of water"), (Fault(_ONE, 403),)),
    Row("a chunk at the edge answers 404", ("had no data for",), (Fault(_EDGE, 404),)),
    Row("every chunk answers 403", ("had no data for", "cells of water"), (Fault("*/?o/*", 403),)),
    Row(
        "one day's chunk of 31 answers 404",
        ("had no data",),
        (Fault(_ONE, 404, 1),),
        valid="2024-10",
    ),
    Row(
        "the axis of latitudes answers 404",
        ("lacks its latitude", "try again later"),
        (Fault("*/latitude/0", 404),),
    ),
    Row(
        "the axis of times answers 404", ("lacks its time", "try again later"), (Fault(_TIME, 404),)
    ),
    Row("503 twice", (), (Fault(_ANY, 503, 2),)),
    Row("a reset twice", (), (Fault(_ANY, "reset", 2),)),
    # The client asks again where the connection is reset, and decodes half a chunk where it is
    # closed: which of both it sees is chance.
    Row(
        "an answer cut in its middle once",
        (),
        (Fault(_ANY, "cut", 1),),
        spec_changes={"attempts": 2},
    ),
    Row(
        "503 for ever",
        ("no answer within 25 s", "last message: the service answers 503 for", "/uo/"),
        (Fault(_ANY, 503),),
        deadline_s=25,
    ),
    Row("no answer for ever", ("no answer within 25 s",), (Fault(_ANY, "stall"),), deadline_s=25),
    Row(
        "the server stops in the middle of a download",
        ("no answer within 25 s",),
        (Fault(_ANY, "gone", after=3),),
        deadline_s=25,
    ),
    Row(
        "the catalogue answers 500 to the first call",
        (),
        (Fault("*/product.stac.json", 500, 1),),
        spec_changes={"attempts": 2, "pause_s": 1.0},
    ),
    Row("a chunk of garbage", ("RuntimeError", "decompress"), (Fault(_ONE, "garbage"),)),
    Row("an empty chunk", ("the client failed",), (Fault(_ONE, "empty"),)),
    Row("a chunk that is too short", ("the client failed",), (Fault(_ONE, "short"),)),
    Row(
        "a bit flipped in a chunk's head", ("the client failed",), (Fault(_ONE, "flipped", bit=3),)
    ),
    Row("a bit flipped in an axis", ("the client failed",), (Fault(_TIME, "flipped", bit=3),)),
    Row(
        "a high bit flipped in a value: an impossible speed",
        ("speeds reach", "damaged"),
        (Fault(_ONE, "value", bit=_cell_bit(_HIGH)),),
    ),
    Row(
        "a sign flipped in a value",
        ("stands out from its neighbours by 0.59", "damaged"),
        (Fault(_ONE, "value", bit=_cell_bit(_SIGN)),),
    ),
    Row(
        "a low bit flipped in a value, which can't be detected",
        (),
        (Fault(_ONE, "value", bit=_cell_bit(_LOW)),),
        tolerance_m_s=_UNDETECTED_M_S,
    ),
    Row("a chunk answers 404 once", (), (Fault(_ONE, 404, 1),), spec_changes={"attempts": 2}),
    Row(
        "a wrong password",
        ("InvalidUsernameOrPassword", f"check {USERNAME} and {PASSWORD}"),
        environment={PASSWORD: "forty-thousand-leagues"},
        is_quick=True,
    ),
    Row(
        "no credentials",
        ("gave up without a reason", f"set {USERNAME} and {PASSWORD}"),
        environment={USERNAME: "", PASSWORD: ""},
        is_quick=True,
    ),
    Row(
        "the login can't be reached",
        ("CouldNotConnectToAuthenticationSystem", "auth.marine.copernicus.eu can't be reached"),
        (Fault(f"CONNECT {LOGIN}*", "reset"),),
        # Fewer of the client's own attempts, as this row would take two minutes otherwise.
        environment={"COPERNICUSMARINE_HTTPS_RETRIES": "1"},
    ),
    Row(
        "the login answers 503",
        ("CouldNotConnectToAuthenticationSystem", "auth.marine.copernicus.eu can't be reached"),
        (Fault("*/openid-connect/token", 503),),
        environment={"COPERNICUSMARINE_HTTPS_RETRIES": "1"},
    ),
    Row(
        "the client is ended by SIGTERM",
        ("ended from outside, by SIGTERM",),
        (Fault(_ANY, "stall"),),
        kill=signal.SIGTERM,
    ),
    Row(
        "the client is ended by SIGKILL",
        ("ended from outside, by SIGKILL",),
        (Fault(_ANY, "stall"),),
        kill=signal.SIGKILL,
        is_quick=True,
    ),
    Row(
        "the client is ended once, and not the second time",
        (),
        (Fault(_ANY, "stall", 1),),
        spec_changes={"attempts": 2, "pause_s": 0.5},
        kill=signal.SIGKILL,
    ),
    Row("garbage is in the cache in place of the file", (), prepare=_garbage),
    Row("an earlier run was killed", (), prepare=_killed_run),
    Row(
        "the end of the period lies outside",
        ("NotCoveredError", "2024-10-31", "lacks 1 of the 31 steps requested"),
        valid="2024-10",
        dataset={"ends": "2024-10-30"},
    ),
    Row(
        "the catalogue is ahead of the data",
        ("its times are",),
        dataset={"ends": "2024-10-05", "lacking": "2024-10-05"},
    ),
    Row(
        "a step is missing in the middle of the data",
        ("its times are",),
        valid="2024-10",
        dataset={"lacking": "2024-10-12"},
    ),
    Row(
        "the box lies partly outside",
        ("CoordinatesOutOfDatasetBounds", "shrink the region"),
        dataset={"north": 11.0},
    ),
    Row("a clock east of Greenwich", (), environment={"TZ": "Asia/Tokyo"}),
    Row(
        "a clock west of Greenwich",
        (),
        environment={"TZ": "Pacific/Honolulu"},
        source=TOTAL,
        valid="2024-10-05T18:00Z",
    ),
    Row(
        "a depth for a dataset of the surface",
        ("CoordinatesOutOfDatasetBounds", "depth"),
        source=TOTAL,
        valid="2024-10-05T18:00Z",
        spec_changes={"depth_m": 0.5},
    ),
    Row(
        "the dataset is being updated",
        ("DatasetUpdating", "try again in an hour"),
        dataset={"updating_from": "2024-10-01T00:00:00Z"},
    ),
    Row(
        "the pinned version is gone",
        ("DatasetVersionNotFound", "Available versions are: ['202406']", "correct `version`"),
        spec_changes={"version": "202211"},
    ),
    Row(
        "the dataset is gone",
        ("DatasetNotFound", "correct the dataset's entry"),
        spec_changes={"dataset": "cmems_mod_glo_phy-cur_anfc_0.083deg_P9D-m"},
    ),
    Row(
        "a variable is gone",
        ("it lists no time steps for a variable 'umean'",),
        spec_changes={"eastward": "umean"},
    ),
)


# Time for starting and ending a process, added to its deadline, s.
_MARGIN_S = 8.0


@dataclass(frozen=True)
class Outcome:
    """The result of a row."""

    error_m_s: float | None
    reason: str
    seconds: float
    limit_s: float
    leftovers: tuple[str, ...]
    clients: int
    written: str

    def is_wrong(self, row: Row) -> bool:
        """Whether a wrong field was accepted."""
        return self.error_m_s is not None and self.error_m_s > row.tolerance_m_s

    @property
    def is_hung(self) -> bool:
        """Whether it took longer than its deadlines allow."""
        return self.seconds > self.limit_s

    @property
    def has_leftovers(self) -> bool:
        """Whether a file or a process was left behind."""
        return bool(self.leftovers) or self.clients > 0


def inject(row: Row, folder: Path) -> Outcome:
    """Inject a row's fault into a download into a folder."""
    entry = row.entry()
    source, season = Copernicus(entry), world.season(row.valid)
    store = world.store(row.source, **row.dataset)
    store.faults.extend(replace(fault) for fault in row.faults)
    downloads, home = folder / "downloads", folder / "home"
    downloads.mkdir(parents=True)
    if row.prepare is not None:
        row.prepare(downloads)
    before = {path: path.read_bytes() for path in downloads.iterdir() if path.is_file()}
    pauses = sum(entry.pause_s * 3**attempt for attempt in range(entry.attempts - 1))
    limit = entry.attempts * (entry.deadline_s + _MARGIN_S) + pauses
    reason, error_m_s = "", None
    with world.connected(store, home, row.environment):
        begun = time.monotonic()
        with _killing(store, row.kill):
            try:
                grid = source.current(world.REGION, season, world.LAND, downloads)
            except StageError as raised:
                reason = str(raised)
            else:
                steps = source.asked(world.REGION, season).steps
                moments = [step_ends(entry, moment)[0] for moment in steps.moments]
                error_m_s = world.max_error_m_s(grid, entry.eastward, entry.northward, *moments)
        seconds = time.monotonic() - begun
        clients = len(clients_of(store))
    left = [path for path in downloads.rglob("*") if path.is_dir() or not _belongs(path, before)]
    if reason:
        left += [path for path in downloads.iterdir() if path not in before]
    return Outcome(
        error_m_s=error_m_s,
        reason=reason,
        seconds=seconds,
        limit_s=limit,
        leftovers=tuple(sorted({path.name for path in left})),
        clients=clients,
        written="\n".join(
            path.read_text("latin-1") for path in folder.rglob("*") if path.is_file()
        ),
    )


def _belongs(path: Path, before: dict[Path, bytes]) -> bool:
    """Whether a file was there before, or is a field or its sidecar."""
    return path in before or path.suffix in {".nc", ".json"}


@contextlib.contextmanager
def _killing(store: LoopbackStore, by: signal.Signals | None) -> Iterator[None]:
    """Kill the first client as soon as it waits for a chunk."""
    ended = threading.Event()

    def watch() -> None:
        while not ended.wait(0.05):
            if any("/uo/" in path for _, path, _ in store.requests):
                for process in clients_of(store):
                    os.kill(process, by or signal.SIGKILL)
                return

    thread = threading.Thread(target=watch, daemon=True)
    if by is not None:
        thread.start()
    try:
        yield
    finally:
        ended.set()
        if by is not None:
            thread.join()


def clients_of(store: LoopbackStore) -> list[int]:
    """Return the other processes that have this store as their proxy."""
    mark = f"HTTP_PROXY=http://127.0.0.1:{store.server.server_address[1]}\0".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if int(folder.name) != os.getpid() and mark in (folder / "environ").read_bytes():
                found.append(int(folder.name))
    return found
