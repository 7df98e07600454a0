"""The program `renew` as a process: where it is, its progress, and its end when a user cancels."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path
from queue import Empty, Queue

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import QgsProcessingException

SETTING = "RENEW_PROGRAM"
# Written beside this file by `renew qgis install`: the path of the program that installed it.
_INSTALLED_BY = Path(__file__).with_name("program.txt")
# Share of the whole that is done when a stage is, percent.
_DONE = {"fetch": 10, "simplify": 12, "project": 15, "choose": 20, "plan": 85, "compare": 90}
# Time between two looks whether the user has cancelled, and until a process that was told to end is
# killed, s.
_PAUSE_S, _PATIENCE_S = 0.2, 10.0
# Variables that are meant for the Python of QGIS.
_OF_QGIS = ("PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP")


def find_program():
    """Return the path of `renew`: of the setting, of the installation, or on the PATH."""
    asked = ProcessingConfig.getSetting(SETTING)
    installed = _INSTALLED_BY.read_text("utf-8").strip() if _INSTALLED_BY.is_file() else ""
    for path in (asked, installed, "renew"):
        found = shutil.which(path) if path else None
        if found:
            return found
    raise QgsProcessingException(
        "The program renew was not found. Install it, run `renew qgis install`, or give its path "
        "in Settings > Options > Processing > Providers > RENEW routes."
    )


def run(arguments, feedback):
    """Run `renew` with some arguments and --json; return its answer, a dictionary.

    Raises QgsProcessingException with its error lines, and where the user cancels.
    """
    command = [find_program(), *arguments, "--json"]
    feedback.pushCommandInfo(" ".join(command))
    variables = {name: text for name, text in os.environ.items() if name not in _OF_QGIS}
    with subprocess.Popen(  # noqa: S603 - the user's own values, and no shell
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        errors="replace",
        env=variables,
        start_new_session=True,
    ) as process:
        answer, lines = [], Queue()
        readers = [
            threading.Thread(target=lambda: answer.append(process.stdout.read())),
            threading.Thread(target=lambda: [lines.put(line) for line in process.stderr]),
        ]
        for reader in readers:
            reader.start()
        errors = _followed(process, lines, feedback)
        for reader in readers:
            reader.join()
        while not lines.empty():
            errors += _told(lines.get(), feedback)
    if feedback.isCanceled():
        raise QgsProcessingException("Cancelled")
    try:
        found = json.loads(answer[0])
    except ValueError:
        found = None
    if process.returncode not in (0, 1) or found is None:
        raise QgsProcessingException("\n".join(errors) or f"renew ended with {process.returncode}")
    return found


def _followed(process, lines, feedback):
    """Report progress until a process ends, or is ended because the user cancels; give errors."""
    errors, told_at = [], 0.0
    while process.poll() is None:
        with contextlib.suppress(Empty):
            errors += _told(lines.get(timeout=_PAUSE_S), feedback)
        if feedback.isCanceled():
            now = time.monotonic()
            if not told_at:
                told_at = now
                os.killpg(process.pid, signal.SIGTERM)
            elif now - told_at > _PATIENCE_S:
                os.killpg(process.pid, signal.SIGKILL)
    return errors


def _told(line, feedback):
    """Report a line of standard error to the user; return it in a list if it is an error."""
    line = line.strip()
    try:
        event = json.loads(line)
    except ValueError:
        event = None
    if not isinstance(event, dict):
        if line:
            feedback.reportError(line)
        return [line.removeprefix("error: ")] if line.startswith("error: ") else []
    stage, status = event.get("stage", ""), event.get("event", "")
    if status == "begun":
        feedback.setProgressText(f"{stage} …")
    elif status == "done" and "season" not in event:
        feedback.setProgress(_DONE.get(stage, 0))
    elif status in {"note", "failed"}:
        feedback.pushInfo(f"{status}: {event.get('detail', '')}")
    return []
