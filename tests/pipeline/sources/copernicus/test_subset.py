"""The process that downloads: it ends with its parent, and notes what was missing."""

from __future__ import annotations

import logging
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.sources.copernicus.client import AnswerLog
from tests.pipeline.processes import ends_within


def test_a_download_ends_when_its_parent_is_killed(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    # Its sleep stands for anything that the client may wait for.
    download = (
        "import os, threading, time\n"
        "from pipeline.machine.interpreters import end_with_parent\n"
        "end_with_parent(os.getppid())\n"
        f"open({str(pid_file)!r}, 'w').write(str(os.getpid()))\n"
        "time.sleep(60)\n"
    )
    script = (
        "import sys\n"
        "from pipeline.machine.interpreters import run_python\n"
        f"run_python(['-c', {download!r}], '', 60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script]) as parent:
        for _ in range(100):
            if pid_file.exists() and pid_file.read_text():
                break
            time.sleep(0.1)
        parent.kill()
    assert ends_within(int(pid_file.read_text()), seconds=5)


def logged(*lines: str) -> AnswerLog:
    """Return the log after urllib3 has written some lines."""
    log = AnswerLog()
    for line in lines:
        log.emit(logging.LogRecord("urllib3", logging.DEBUG, "", 0, line, (), None))
    return log


def test_missing_chunks_are_noted(capsys: pytest.CaptureFixture[str]) -> None:
    store = "/arco/PRODUCT/data_202311/timeChunked.zarr"
    log = logged(
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.224?x-cop-user=nemo HTTP/1.1" 403 0',
        f'http://mds.invalid:80 "GET http://mds.invalid{store}/vo/1.2.3?x=y HTTP/1.1" 404 243',
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.225 HTTP/1.1" 200 1000',
        f'http://mds.invalid:80 "GET {store}/.zattrs HTTP/1.1" 403 0',
        "Starting new HTTPS connection (1): mds.invalid:443",
    )
    assert log.missing_chunks == {(store, (378, 2, 67, 224)), (store, (1, 2, 3))}
    assert capsys.readouterr().err == ""


def test_errors_of_the_service_are_reported_without_the_user_name(
    capsys: pytest.CaptureFixture[str],
) -> None:
    logged('http://mds.invalid:80 "GET /a.zarr/uo/1.2?x-cop-user=nemo HTTP/1.1" 503 0')
    assert capsys.readouterr().err == "the service answers 503 for /a.zarr/uo/1.2\n"
