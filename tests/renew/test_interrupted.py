"""Ctrl-C while kernels run; each run in its own process."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from tests.renew.test_compiled import install

# A kernel with results of each kind, and one that it calls. It is at work when the signal comes,
# which is raised as soon as its results are made.
INTERRUPTED = """
import os, signal, sys, threading
import numpy as np
from typing import NamedTuple
from renew._compiled import kernel

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it

class Results(NamedTuple):
    one: np.ndarray
    other: np.ndarray

@kernel
def root_of_sum(count):
    total = 0.0
    for k in range(count):
        total = np.sqrt(total + k)
    return total

@kernel
def results(count):
    total = root_of_sum(count)
    return Results(np.full(3, total), np.full(2, total)), np.full(3, total), [total]

results(1)
for _ in range(2):
    threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        results(60_000_000)
    except KeyboardInterrupt:
        print("interrupted")
"""


def test_ctrl_c_within_a_kernel_is_a_keyboard_interrupt(tmp_path: Path) -> None:
    package = install(tmp_path)
    (package / "interrupted.py").write_text(INTERRUPTED)
    done = subprocess.run(
        [sys.executable, "-m", "renew.interrupted"],
        cwd=package.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "interrupted\n" * 2), done.stderr


# Plans that are interrupted at random moments, and prints how each of them ended.
INTERRUPTED_PLANS = """
import random, signal
import renew
from tests.strategies import PAPER_VESSEL, single_gyre

def plan():
    found = renew.plan(chart, gyre, PAPER_VESSEL, (10.0, 10.0), (90.0, 90.0), classes=4)
    renew.contingency(found.best, chart, gyre, PAPER_VESSEL)
    return found

(chart, gyre), moments = single_gyre(), random.Random(1)
plan()
signal.signal(signal.SIGALRM, signal.default_int_handler)
for _ in range(500):
    try:
        signal.setitimer(signal.ITIMER_REAL, moments.uniform(0.001, 0.08))
        plan()
        signal.setitimer(signal.ITIMER_REAL, 0)
        print("ended")
    except BaseException as error:
        print(type(error).__name__)
"""


@pytest.mark.slow
def test_plans_that_are_interrupted_end_with_a_keyboard_interrupt(root: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_PLANS],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    ended = Counter(done.stdout.split())
    assert ended.total() == 500
    assert set(ended) <= {"KeyboardInterrupt", "ended"}
    assert ended["KeyboardInterrupt"] >= 300
