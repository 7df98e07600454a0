"""The fault table: each row is injected into a download of the unmodified client."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.loopback_store.fault_table import inject
from tests.loopback_store.rows import ROWS, Row
from tests.loopback_store.server import PASSWORD, USERNAME


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=row.name, marks=() if row.is_quick else (pytest.mark.slow,))
        for row in ROWS
    ],
)
def test_no_fault_causes_a_wrong_field_a_hang_or_leftovers(row: Row, tmp_path: Path) -> None:
    outcome = inject(row, tmp_path)
    assert not outcome.is_wrong(row), f"accepted, with an error of {outcome.error_m_s} m/s"
    assert not outcome.is_hung, f"took {outcome.seconds:.1f} s of {outcome.limit_s:.1f} s"
    assert not outcome.has_leftovers, f"left {outcome.leftovers}, {outcome.clients} clients"
    for part in row.message:
        assert part in outcome.reason
    assert bool(outcome.reason) == bool(row.message), outcome.reason
    for secret in (USERNAME, PASSWORD):
        assert secret not in outcome.reason
        assert secret not in outcome.written
