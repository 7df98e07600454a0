"""Departures count from the currents' reference time, across midnight and leap days."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from pipeline.nightly.config import DepartureSpec


def leaves(spec: DepartureSpec, reference: datetime) -> list[str]:
    """Return the departures after a reference time."""
    return [f"{one.after(reference):%d %b %H:%M}" for one in spec.departures()]


def test_names_are_the_same_each_night() -> None:
    spec = DepartureSpec(first="06:00Z", every="6h", count=5)
    assert [one.name for one in spec.departures()] == [
        "0600Z",
        "1200Z",
        "1800Z",
        "0000Z+1",
        "0600Z+1",
    ]


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (datetime(2026, 11, 21, tzinfo=UTC), ["21 Nov 06:00", "22 Nov 18:00"]),
        (datetime(2026, 11, 21, 6, tzinfo=UTC), ["21 Nov 06:00", "22 Nov 18:00"]),
        (datetime(2026, 11, 21, 6, 1, tzinfo=UTC), ["22 Nov 06:00", "23 Nov 18:00"]),
        (datetime(2028, 2, 28, 12, tzinfo=UTC), ["29 Feb 06:00", "01 Mar 18:00"]),
        (datetime(2026, 12, 31, 23, 59, tzinfo=UTC), ["01 Jan 06:00", "02 Jan 18:00"]),
    ],
)
def test_the_first_is_at_or_after_the_reference_time(
    reference: datetime, expected: list[str]
) -> None:
    assert leaves(DepartureSpec(first="06:00Z", every="36h", count=2), reference) == expected
