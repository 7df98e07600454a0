"""What a night of 20,000 cases, the largest, takes: `python -m tests.bench.night_plans`.

It prints the tables of docs/how-to/nightly.md; a test compares them.
"""

import math
from dataclasses import dataclass

PLANS = 20_000
HOURS = 6.0
"""Time from the forecast to the morning: `limit_hours` of the night's configuration."""
KEPT = 14
"""Cycles that are kept: `keep` of the night's configuration."""

# Time for batching, scheduling and writing, as a share of the time for planning: the largest that
# `python -m tests.bench nightly` found on nights in Palawan (0.01 to 0.04).
OVERHEAD = 0.04
# Memory of the job's own process with few cases, MB.
MAIN_MB = 300.0
PER_CORE_HOUR = {"reserved or spot": 0.012, "on demand": 0.045}
"""Prices of a core for an hour in a data centre, euro: assumptions, to be replaced by one's own."""
PER_GB_MONTH = 0.08
"""Price of a gigabyte on a shared disk for a month, euro: an assumption likewise."""


@dataclass(frozen=True, slots=True)
class Case:
    """What one plan takes, measured with compiled kernels on one core.

    Attributes
    ----------
    name : which case.
    plan_s : processor time to plan all classes of a case, with bound and verification, s.
    worker_mb : memory of a worker at its largest, with libraries and chart, MB.
    held_kb : memory of the job's own process for a case's rows, while it writes the files, kB.
    stored_kb : a case's routes, twice: in the Parquet tables and in the GeoPackage, kB.
    """

    name: str
    plan_s: float
    worker_mb: float
    held_kb: float
    stored_kb: float


PALAWAN = Case(
    "Palawan, 7 m vessel, full chart", plan_s=6.0, worker_mb=622, held_kb=51, stored_kb=16
)
GYRE = Case("single gyre", plan_s=0.36, worker_mb=391, held_kb=29, stored_kb=9)
CASES = (PALAWAN, GYRE)


def core_hours(case: Case) -> float:
    """Hours that one core would need for all plans."""
    return PLANS * case.plan_s * (1 + OVERHEAD) / 3600


def cores(case: Case) -> int:
    """Cores that are done with all plans in time."""
    return math.ceil(core_hours(case) / HOURS)


def hours(case: Case, number: int) -> float:
    """Hours that a number of cores needs for all plans."""
    return core_hours(case) / number


def memory_gb(case: Case) -> float:
    """Memory of all workers and of the job's own process, GB."""
    return (cores(case) * case.worker_mb + MAIN_MB + PLANS * case.held_kb / 1000) / 1000


def disk_gb(case: Case, cycles: int = 1) -> float:
    """Disk that the cycles take which are kept, GB."""
    return PLANS * case.stored_kb * cycles / 1e6


def table() -> str:
    """The reckoning as a table in Markdown."""
    rows = [
        ("", *(case.name for case in CASES)),
        ("---", *("---:" for _ in CASES)),
        ("one plan, processor time", *(f"{case.plan_s:g} s" for case in CASES)),
        ("core hours", *(f"{core_hours(case):,.0f}" for case in CASES)),
        (f"cores for a night of {HOURS:g} h", *(f"{cores(case):,}" for case in CASES)),
        ("memory", *(f"{memory_gb(case):,.1f} GB" for case in CASES)),
        ("disk a night", *(f"{disk_gb(case):,.1f} GB" for case in CASES)),
        (f"disk, {KEPT} nights", *(f"{disk_gb(case, KEPT):,.1f} GB" for case in CASES)),
        *(
            (f"cores, {how}, a night", *(f"{core_hours(case) * price:,.2f} €" for case in CASES))
            for how, price in PER_CORE_HOUR.items()
        ),
        ("disk, a month", *(f"{disk_gb(case, KEPT) * PER_GB_MONTH:,.2f} €" for case in CASES)),
    ]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def machines_table() -> str:
    """How long one machine takes, as a table in Markdown."""
    rows = [
        ("cores", *(f"hours, {case.name}" for case in CASES)),
        ("---:", *("---:" for _ in CASES)),
        *(
            (str(number), *(f"{hours(case, number):.1f}" for case in CASES))
            for number in (1, 2, 4, 8, 16)
        ),
    ]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


if __name__ == "__main__":
    print(table())
    print(machines_table())
