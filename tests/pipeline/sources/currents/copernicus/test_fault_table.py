"""The fault table: each row happens to the unmodified client at the loopback store."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.loopback_store.fault_table import inject
from tests.loopback_store.rows import ROWS
from tests.loopback_store.server import PASSWORD, USERNAME

if TYPE_CHECKING:
    from pathlib import Path

    from tests.loopback_store.rows import Row


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, id=row.name, marks=() if row.is_quick else (pytest.mark.slow,))
        for row in ROWS
    ],
)
def test_no_fault_ends_in_a_wrong_field_a_hang_or_a_leftover(row: Row, tmp_path: Path) -> None:
    outcome = inject(row, tmp_path)
    assert not outcome.is_wrong(row), f"accepted, and off by {outcome.wrong_by_m_s} m/s"
    assert not outcome.is_hung, f"took {outcome.seconds:.1f} s of {outcome.longest_s:.1f} s"
    assert not outcome.is_littered, f"left {outcome.leftovers}, {outcome.clients} clients"
    for words in row.said:
        assert words in outcome.reason
    assert bool(outcome.reason) == bool(row.said), outcome.reason
    for secret in (USERNAME, PASSWORD):
        assert secret not in outcome.reason
        assert secret not in outcome.written
