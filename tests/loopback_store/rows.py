"""The rows of the fault table: what goes wrong, and what must be said of it."""

from __future__ import annotations

import signal
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.sources.currents.copernicus.account import PASSWORD, USERNAME
from pipeline.sources.currents.copernicus.adapter import Copernicus
from tests.loopback_store import world
from tests.loopback_store.server import LOGIN, Fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from pipeline.scenario.catalogue import CopernicusSpec

DAILY, TOTAL = "copernicus-forecast-daily", "copernicus-total-hourly"
# A cell that is off by less still looks like the sea; see `pipeline.sources.quality.acceptance`.
_UNSEEN_M_S = 0.4


@dataclass(frozen=True)
class Row:
    """One fault: how it is injected, and the words that its reason must hold.

    Without any the field must come, and be the truth, or off by `at_most_m_s` where no more can be
    told. `changes` are those of the catalogue's entry, `service` those of the store's dataset;
    `kill` ends the first client, and `prepare` is given the downloads' folder before.
    """

    name: str
    said: tuple[str, ...]
    faults: tuple[Fault, ...] = ()
    source: str = DAILY
    valid: str = "2024-10-05"
    deadline_s: float = 60.0
    changes: dict[str, Any] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    service: dict[str, Any] = field(default_factory=dict)
    kill: signal.Signals | None = None
    prepare: Callable[[Path], None] | None = None
    at_most_m_s: float = world.TOLERANCE_M_S
    is_quick: bool = False

    def entry(self) -> CopernicusSpec:
        """The dataset's entry with a short deadline; one attempt where no more are asked for."""
        fast = {"deadline_s": self.deadline_s, "attempts": 1, "pause_s": 0.0}
        return world.spec(self.source).model_copy(update={**fast, **self.changes})


def _garbage(folder: Path) -> None:
    """Put rubbish where the file will be kept, with a sidecar that knows nothing of it."""
    for suffix in ("nc", "json"):
        for name in (f"{world.spec(DAILY).dataset}_2024-10-05", _kept_stem()):
            (folder / f"{name}.{suffix}").write_bytes(b"rubbish")


def _kept_stem() -> str:
    """Name under which the daily field is kept."""
    source, season = Copernicus(world.spec(DAILY)), world.season("2024-10-05")
    return source._kept(source._order(world.REGION, season), season, Path()).file.stem


def _killed_run(folder: Path) -> None:
    """Leave what a run that was killed leaves: its workshop, the client's own file in it."""
    workshop = folder / f"{_kept_stem()}.{_dead_process()}.0123abcd.partial"
    workshop.mkdir()
    (workshop / f"{_kept_stem()}.nc.k3x9_q2z").write_bytes(b"half a file")


def _dead_process() -> int:
    """A number that no process has: above the kernel's limit."""
    return int(Path("/proc/sys/kernel/pid_max").read_text()) + 1


# The region needs nine chunks, by row and column 32-34 and 111-113; (33, 112) is all island, and
# of the last column the region has but one line of cells.
_ANY, _ONE, _EDGE, _TIME = "*/uo/*", "*/uo/*.34.111", "*/?o/*.34.113", "*.zarr/time/0"

# Bits of a float32: its sign, the highest of its exponent, the highest of its fraction.
_SIGN, _HIGH, _LOW = 31, 30, 22


def _cell_bit(bit: int) -> int:
    """Number of a bit of one cell of `_ONE`: inside the region, and 0.3 m/s strong that day."""
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
    Row("an answer cut in its middle once", (), (Fault(_ANY, "cut", 1),)),
    Row(
        "503 for ever",
        ("no answer within 25 s", "last heard: the service answers 503 for", "/uo/"),
        (Fault(_ANY, 503),),
        deadline_s=25,
    ),
    Row("no answer for ever", ("no answer within 25 s",), (Fault(_ANY, "stall"),), deadline_s=25),
    Row(
        "the server goes in the middle of a download",
        ("no answer within 25 s",),
        (Fault(_ANY, "gone", after=3),),
        deadline_s=25,
    ),
    Row(
        "the catalogue answers 500 to the first call",
        (),
        (Fault("*/product.stac.json", 500, 1),),
        changes={"attempts": 2, "pause_s": 1.0},
    ),
    Row("a chunk of rubbish", ("RuntimeError", "decompress"), (Fault(_ONE, "garbage"),)),
    Row("an empty chunk", ("the client failed",), (Fault(_ONE, "empty"),)),
    Row("a chunk that is too short", ("the client failed",), (Fault(_ONE, "short"),)),
    Row(
        "a bit flipped in a chunk's head",
        ("the client failed",),
        (Fault(_ONE, "flipped", bit=3),),
    ),
    Row("a bit flipped in an axis", ("the client failed",), (Fault(_TIME, "flipped", bit=3),)),
    Row(
        "a high bit flipped in a figure: an impossible speed",
        ("speeds reach", "damaged"),
        (Fault(_ONE, "value", bit=_cell_bit(_HIGH)),),
    ),
    Row(
        "a sign flipped in a figure",
        ("stands out from its neighbours by 0.59", "damaged"),
        (Fault(_ONE, "value", bit=_cell_bit(_SIGN)),),
    ),
    Row(
        "a low bit flipped in a figure, which nobody can see",
        (),
        (Fault(_ONE, "value", bit=_cell_bit(_LOW)),),
        at_most_m_s=_UNSEEN_M_S,
    ),
    Row("a chunk answers 404 once", (), (Fault(_ONE, 404, 1),), changes={"attempts": 2}),
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
        # Fewer of the client's own attempts, or this one row would take two minutes.
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
        "the client is ended once, and let be the second time",
        (),
        (Fault(_ANY, "stall", 1),),
        changes={"attempts": 2, "pause_s": 0.5},
        kill=signal.SIGKILL,
    ),
    Row("rubbish lies where the file will be kept", (), prepare=_garbage),
    Row("an earlier run was killed", (), prepare=_killed_run),
    Row(
        "the end of the time lies outside",
        ("NotCoveredError", "2024-10-31", "of the 31 steps asked for 1 are not in it"),
        valid="2024-10",
        service={"ends": "2024-10-30"},
    ),
    Row(
        "the catalogue is ahead of the data",
        ("its times are",),
        service={"ends": "2024-10-05", "lacking": "2024-10-05"},
    ),
    Row(
        "a step is missing in the middle of the data",
        ("its times are",),
        valid="2024-10",
        service={"lacking": "2024-10-12"},
    ),
    Row(
        "the box lies outside in part",
        ("CoordinatesOutOfDatasetBounds", "shrink the region"),
        service={"north": 11.0},
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
        changes={"depth_m": 0.5},
    ),
    Row(
        "the dataset is being updated",
        ("DatasetUpdating", "try again in an hour"),
        service={"updating_from": "2024-10-01T00:00:00Z"},
    ),
    Row(
        "the pinned version is gone",
        ("DatasetVersionNotFound", "Available versions are: ['202406']", "mend `version`"),
        changes={"version": "202211"},
    ),
    Row(
        "the dataset is gone",
        ("DatasetNotFound", "mend the dataset's entry"),
        changes={"dataset": "cmems_mod_glo_phy-cur_anfc_0.083deg_P9D-m"},
    ),
    Row(
        "a variable is gone",
        ("it lists no time steps for a variable 'umean'",),
        changes={"eastward": "umean"},
    ),
)
