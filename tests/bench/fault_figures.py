"""The fault table: every way in which the currents' service was seen to fail, injected."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.bench.figure import Figure, at_most
from tests.loopback_store import world
from tests.loopback_store.fault_table import inject
from tests.loopback_store.rows import ROWS


def figures() -> Iterator[Figure]:
    """Yield what became of each row, and the counts: some ten minutes."""
    wrong = hung = littered = unseen = 0
    for row in ROWS:
        with tempfile.TemporaryDirectory() as folder:
            outcome = inject(row, Path(folder))
        wrong += outcome.is_wrong(row)
        hung += outcome.is_hung
        littered += outcome.has_leftovers
        unseen += (outcome.error_m_s or 0.0) > world.TOLERANCE_M_S
        became = outcome.reason or f"accepted, off by {outcome.error_m_s:.1g} m/s at most"
        good = not (outcome.is_wrong(row) or outcome.is_hung or outcome.has_leftovers)
        yield Figure(f"fault: {row.name}", "", f"{outcome.seconds:.1f} s: {became[:70]}", good)
    name = f"fault table, {len(ROWS)} rows"
    yield at_most(f"{name}: wrong fields accepted", wrong, 0, digits=0)
    yield Figure(f"{name}: off by less than can be told", "", str(unseen))
    yield at_most(f"{name}: hangs past the deadline", hung, 0, digits=0)
    yield at_most(f"{name}: leftovers", littered, 0, digits=0)
