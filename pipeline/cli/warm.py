"""The command `renew warm`: compile the planner's code before the first run needs it."""

import contextlib
import itertools
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.cli.log_lines import json_lines, progress_bar
from pipeline.errors import RequestError, StageError

_MB = 1e6


def warm() -> str:
    """Compile all functions that are not compiled yet, show the progress, and return a summary.

    Raises
    ------
    RequestError
        The compiler is switched off, or NUMBA_CACHE_DIR can't be written.
    StageError
        The machine code can't be saved.
    """
    from renew import _compiled

    if not _compiled.is_switched_on():
        raise RequestError("NUMBA_DISABLE_JIT is set, and so nothing would be compiled: unset it")
    folder = _compiled.cache_folder()
    _refuse_elsewhere(folder)
    started = time.perf_counter()
    number = 0
    if not _compiled.has_all():
        from renew.warming import REHEARSALS, rehearse  # importing this loads some code

        with _counted_compilations() as compiled, _progress(len(REHEARSALS)) as on_step:
            for what in rehearse():
                on_step(what, compiled())
            number = compiled()
        _compiled.note_all()
    size = sum(file.stat().st_size for file in folder.iterdir()) / _MB
    seconds = time.perf_counter() - started
    done = f"Compiled {number:,} functions" if number else "Nothing had to be compiled"
    text = f"{done} ({seconds:.1f} s); machine code for "
    text += f"{_compiled.processor()} in {folder} ({size:.1f} MB)"
    if _compiled.cache_is_temporary():
        text += ". That is a temporary folder: set NUMBA_CACHE_DIR to one that lasts"
    return text


def _refuse_elsewhere(folder: Path) -> None:
    """Raise StageError if machine code would go to another folder than NUMBA_CACHE_DIR names."""
    asked = os.environ.get("NUMBA_CACHE_DIR")
    if asked and folder.parent.resolve() != Path(asked).resolve():
        raise StageError(
            f"NUMBA_CACHE_DIR = {asked!r} can't be written; choose another folder, or unset it"
        )


@contextlib.contextmanager
def _counted_compilations() -> Iterator[Callable[[], int]]:
    """Yield a function that counts the compiled functions, without those from the cache."""
    from numba.core import event

    with event.install_recorder("numba:compile") as recorder:
        yield lambda: sum(one.is_start for _, one in recorder.buffer)


@contextlib.contextmanager
def _progress(steps: int) -> Iterator[Callable[[str, int], None]]:
    """Yield a function that reports a step: as a bar on a terminal, else as a line of JSON."""
    if sys.stderr.isatty():
        with progress_bar("Compiling") as bar:
            task = bar.add_task("starting", total=steps, completed=-1)
            yield lambda what, compiled: bar.update(
                task, advance=1, description=f"{what} ({compiled} so far)"
            )
        return
    log, numbers = json_lines(sys.stderr), itertools.count()
    yield lambda what, compiled: log.info(
        "compiling", step=next(numbers), steps=steps, plan=what, compiled=compiled
    )
