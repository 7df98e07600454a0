"""The number of cases that the slow robustness tests try, and their seed, from the environment."""

from __future__ import annotations

import os
import random

SEED = os.environ.get("RENEW_ROBUSTNESS_SEED", "20260111")
"""Seed of all cases; another one draws others."""


def number(kind: str, default: int) -> int:
    """Return the number of cases of a kind, such as `RENEW_ROBUSTNESS_NIGHTS=2000`."""
    return int(os.environ.get(f"RENEW_ROBUSTNESS_{kind.upper()}", default))


def draw(kind: str, case: int) -> random.Random:
    """Return the random numbers of a case, the same in each campaign with this seed."""
    return random.Random(f"{SEED} {kind} {case}")  # noqa: S311 - a test's seed
