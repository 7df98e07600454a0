"""A probe that stands in for one that files hang or crash; its worker imports nothing else."""

import os
import signal
import time
from pathlib import Path


def stand_in_probe(file: Path, cpu_s: float) -> str:
    """Do to a file what its name says."""
    del cpu_s
    if "hang" in file.name:
        time.sleep(60)
    if "crash" in file.name:
        os.kill(os.getpid(), signal.SIGSEGV)
    return ""
