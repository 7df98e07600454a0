"""Times until RENEW answers: imports, help, and the first plan of a process, compiled before."""

from __future__ import annotations

from collections.abc import Iterator

from tests.bench.clock import ran
from tests.bench.figure import Figure, at_most
from tests.strategies import PAPER_VESSEL, SINGLE_GYRE_ISLANDS

# Without the tests' modules, whose own imports a user's plan does not make.
FIRST_PLAN = f"""
import renew
from shapely import Polygon, box
chart = renew.Chart(box(0, 0, 100, 100), [Polygon(one) for one in {SINGLE_GYRE_ISLANDS}])
vessel = renew.{PAPER_VESSEL}
renew.plan(chart, renew.GyreCurrent(0.8, 100, 100), vessel, (10.0, 10.0), (90.0, 90.0))
"""


def figures() -> Iterator[Figure]:
    """Yield each command's least time of three, after one that is not counted (s)."""
    commands = {
        "import renew": (("-c", "import renew"), 0.5),
        "import renew and plan the single gyre": (("-c", FIRST_PLAN), 1.0),
        "renew --help": (("-m", "pipeline.cli.main", "--help"), 0.25),
    }
    for name, (words, limit) in commands.items():
        times = [ran(*words).cpu for _ in range(4)]
        yield at_most(f"{name}: CPU time", min(times[1:]), limit, " s")
