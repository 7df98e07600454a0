"""No file of land, havens, depths or currents makes a library open a socket or another file."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from pipeline.errors import RequestError
from pipeline.sources.land.vector import read_havens
from tests.commands import ran
from tests.pipeline.sources import pointing_files

# What belongs to the process itself: names of its services, not of a file's addresses.
_TRACED = ("strace", "-f", "-qq", "-e", "trace=open,openat,openat2,creat,socket,connect", "-o")


def test_havens_beside_a_fifo_are_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "havens.csv").write_text("name,lon,lat\na,120,10\n")
    os.mkfifo(tmp_path / "havens.prj")
    with pytest.raises(RequestError, match=r"havens\.prj is a FIFO, not a file"):
        read_havens(tmp_path / "havens.csv")


@pytest.fixture
def asked() -> list[bytes]:
    """Count what is asked of a loopback address."""
    found: list[bytes] = []
    listener = socket.create_server(("127.0.0.1", 0))

    def listen() -> None:
        while True:
            try:
                one, _ = listener.accept()
            except OSError:
                return
            found.append(b"")
            one.close()

    threading.Thread(target=listen, daemon=True).start()
    found.append(f"http://127.0.0.1:{listener.getsockname()[1]}/x".encode())
    return found


@pytest.mark.filterwarnings("ignore")
def test_files_that_lead_elsewhere_open_no_socket_and_no_other_file(
    tmp_path: Path, asked: list[bytes]
) -> None:
    folder, outside = tmp_path / "given", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    address = asked.pop().decode()
    pointing_files.write_all(folder, address, outside)
    command = [sys.executable, "-m", pointing_files.__name__, str(folder)]
    log = tmp_path / "opened"
    is_traced = shutil.which("strace") is not None and (
        subprocess.run([*_TRACED, "/dev/null", "true"], check=False).returncode == 0
    )
    # One that follows a FIFO, or a view without end, never ends.
    found = ran(
        *([*_TRACED, str(log), *command] if is_traced else command),
        env={**os.environ, "PYTHONWARNINGS": "ignore", "NO_PROXY": "*"},
        timeout=240,
    )
    ends = dict(line.split("\t") for line in found.splitlines())
    tried = {one.name for one in filter(pointing_files.is_tried, folder.iterdir())}
    assert ends.keys() == tried
    assert len(tried) > 40
    assert asked == []
    # What does not lead elsewhere after all: GDAL neither fetches nor opens such a name.
    harmless = ("-named-", "crs-ogc", "network.kml", "-prj-2", "-prj-3", "crs-2", "crs-3")
    read = [name for name, end in ends.items() if end == "read"]
    assert [name for name in read if not any(part in name for part in harmless)] == []
    if not is_traced:
        pytest.skip("strace is not here: which files were opened is not known")
    lines = log.read_text(errors="replace").splitlines()
    assert [line for line in lines if str(outside) in line or "AF_INET" in line] == []
