"""Whether processes run, for the tests that start and kill them."""

from __future__ import annotations

import time
from pathlib import Path


def is_running(process_id: int) -> bool:
    """Whether a process runs and is no zombie."""
    status = Path(f"/proc/{process_id}/stat")
    try:
        return status.read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ends_within(process_id: int, seconds: float) -> bool:
    """Whether a process ends in time."""
    for _ in range(round(10 * seconds)):
        if not is_running(process_id):
            return True
        time.sleep(0.1)
    return False
