"""Which workers can plan: those that run this version and see the files."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import StageError
from pipeline.machine.storage.store import artefact_key
from pipeline.stages.workers.connection import within

if TYPE_CHECKING:
    from distributed import Client

# Time within which all workers must have answered, s: they import what plans first.
_ANSWER_S = 60.0
_OTHER_VERSION = "another version of RENEW or of its libraries; install the same on all machines"


def own_identity() -> str:
    """Return a hash of all code and libraries that plans depend on."""
    return artefact_key("evaluate")


def refuse_other_version(identity: str) -> None:
    """Refuse to work for a job of another version: its results would not be the same.

    Raises
    ------
    StageError
        This worker's code or libraries are others.
    """
    if own_identity() != identity:
        raise StageError(f"a Dask worker runs {_OTHER_VERSION}")


def worker_fault(identity: str, path: str) -> str:
    """Say why this worker can't plan for a job with an identity; empty if it can."""
    if own_identity() != identity:
        return f"runs {_OTHER_VERSION}"
    if not Path(path).is_file():
        return f"can't read {path}; give all workers access to the same output folder"
    return ""


def refuse_unfit_workers(client: Client, address: str, path: Path) -> None:
    """Refuse workers that can't plan, can't read a path, or do not answer.

    Raises
    ------
    StageError
        One line that names them.
    """
    ask = partial(client.run, worker_fault, own_identity(), str(path), on_error="return")
    try:
        answers = within(_ANSWER_S, ask)
    except Exception as error:
        reason = " ".join(str(error).split()) or f"no answer within {_ANSWER_S:g} s"
        raise StageError(
            f"workers of the Dask scheduler at {address!r} do not answer ({reason}); restart them"
        ) from error
    faults: dict[str, list[str]] = {}
    for worker, answer in answers.items():
        if isinstance(answer, BaseException):
            answer = (  # noqa: PLW2901
                f"can't run RENEW ({type(answer).__name__}: {' '.join(str(answer).split())}); "
                "install the same version on all machines"
            )
        if answer:
            faults.setdefault(answer, []).append(worker)
    if faults:
        lines = [f"Dask worker {', '.join(names)} {fault}" for fault, names in faults.items()]
        raise StageError("; ".join(lines))
