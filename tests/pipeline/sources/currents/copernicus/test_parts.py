"""The parts that a download is made of: child process, credentials, kept files."""

from __future__ import annotations

import base64
import configparser
import json
import logging
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.sources.currents.copernicus.account import PASSWORD, USERNAME, without_secrets
from pipeline.sources.currents.copernicus.cache import Kept
from pipeline.sources.currents.copernicus.subprocess_deadline import run_with_deadline
from pipeline.sources.currents.copernicus.subset import Heard
from pipeline.store import file_hash

# --- the child ----------------------------------------------------------------------------------


def is_alive(process: int) -> bool:
    """Whether a process still does anything."""
    status = Path(f"/proc/{process}/stat")
    try:
        return status.read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ends(process: int, within_s: float) -> bool:
    """Whether a process ends in time."""
    for _ in range(round(10 * within_s)):
        if not is_alive(process):
            return True
        time.sleep(0.1)
    return False


def test_a_child_that_hangs_is_killed_with_its_children_at_the_deadline(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    script = (
        "import subprocess, sys, time\n"
        f"child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(pid_file)!r}, 'w').write(str(child.pid))\n"
        "sys.stderr.write('the last words')\n"
        "sys.stderr.flush()\n"
        "time.sleep(60)\n"
    )
    begun = time.monotonic()
    ended = run_with_deadline([sys.executable, "-c", script], "", 1.5)
    assert (ended.code, ended.errors) == (None, "the last words")
    assert 1.4 < time.monotonic() - begun < 10
    assert ends(int(pid_file.read_text()), within_s=5), "the child's own child lives on"


def test_a_childs_input_exit_code_answer_and_errors_come_through() -> None:
    script = "import sys; said = sys.stdin.read(); sys.stderr.write(said * 2); print(said)"
    ended = run_with_deadline([sys.executable, "-c", script + "; sys.exit(3)"], "ab", 30)
    assert (ended.code, ended.answer, ended.errors) == (3, "ab\n", "abab")


def test_a_download_ends_when_the_process_that_wants_it_is_killed(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    # What the child waits for here stands for any wait of the client's.
    child = (
        "import threading, time\n"
        "from pipeline.sources.currents.copernicus import subset as child\n"
        "import os\n"
        "threading.Thread(target=child._end_with, args=(os.getppid(),), daemon=True).start()\n"
        f"open({str(pid_file)!r}, 'w').write(str(os.getpid()))\n"
        "time.sleep(60)\n"
    )
    script = (
        "import sys\n"
        "from pipeline.sources.currents.copernicus.subprocess_deadline import run_with_deadline\n"
        f"run_with_deadline([sys.executable, '-c', {child!r}], '', 60)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script]) as parent:
        for _ in range(100):
            if pid_file.exists() and pid_file.read_text():
                break
            time.sleep(0.1)
        parent.kill()
    assert ends(int(pid_file.read_text()), within_s=5)


def heard(*lines: str) -> Heard:
    """What is noted of the lines that urllib3 logs."""
    listener = Heard()
    for line in lines:
        listener.emit(logging.LogRecord("urllib3", logging.DEBUG, "", 0, line, (), None))
    return listener


def test_chunks_that_were_not_there_are_noted(capsys: pytest.CaptureFixture[str]) -> None:
    store = "/arco/PRODUCT/data_202311/timeChunked.zarr"
    listener = heard(
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.224?x-cop-user=nemo HTTP/1.1" 403 0',
        f'http://mds.invalid:80 "GET http://mds.invalid{store}/vo/1.2.3?x=y HTTP/1.1" 404 243',
        f'http://mds.invalid:80 "GET {store}/uo/378.2.67.225 HTTP/1.1" 200 1000',
        f'http://mds.invalid:80 "GET {store}/.zattrs HTTP/1.1" 403 0',
        "Starting new HTTPS connection (1): mds.invalid:443",
    )
    assert listener.missing == {(store, (378, 2, 67, 224)), (store, (1, 2, 3))}
    assert capsys.readouterr().err == ""


def test_trouble_is_told_aloud_and_names_nobody(capsys: pytest.CaptureFixture[str]) -> None:
    heard('http://mds.invalid:80 "GET /a.zarr/uo/1.2?x-cop-user=nemo HTTP/1.1" 503 0')
    assert capsys.readouterr().err == "the service answers 503 for /a.zarr/uo/1.2\n"


# --- credentials --------------------------------------------------------------------------------


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Give the client's own folder, empty, and no credentials in the environment."""
    for name in list(os.environ):
        if name.startswith("COPERNICUS"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path))
    folder = tmp_path / ".copernicusmarine"
    folder.mkdir()
    return folder


def test_credentials_are_blanked_out_of_what_the_client_says(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(USERNAME, "captain")
    monkeypatch.setenv(PASSWORD, "captain-nemo")
    stored = "[credentials]\nusername = ahab\npassword = moby=dick\n"
    (home / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    said = without_secrets("login captain-nemo of captain or ahab with moby=dick failed")
    assert said == "login *** of *** or *** with *** failed"


def test_credentials_in_addresses_are_blanked_as_they_are_written_there(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del home
    monkeypatch.setenv(USERNAME, "nemo@sea.org")
    monkeypatch.setenv(PASSWORD, "p&ss word")
    said = without_secrets(
        "https://s3/uo/1.2?x-cop-client=a&x-cop-user=nemo_of_the_service&b=c, form "
        "username=nemo%40sea.org&password=p%26ss+word, proxy http://me:secret@proxy:3128/"
    )
    assert said == (
        "https://s3/uo/1.2?x-cop-client=a&x-cop-user=***&b=c, form "
        "username=***&password=***, proxy http://***@proxy:3128/"
    )


@pytest.mark.parametrize(
    "stored",
    [
        "username=ahab\npassword=moby-dick\n",
        "[credentials]\nusername: ahab\npassword: moby-dick\n",
        "ahab\nmoby-dick\n",
        "[ahab]\n[moby-dick\n",
    ],
)
def test_the_errors_of_a_spoilt_credentials_file_show_nothing_of_it(
    home: Path, stored: str
) -> None:
    (home / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    try:
        configparser.RawConfigParser().read_string(stored)
        error = stored
    except configparser.Error as raised:
        error = str(raised)
    assert "ahab" in error or "moby" in error
    said = without_secrets(error)
    assert "ahab" not in said
    assert "moby-dick" not in said


# --- kept files ---------------------------------------------------------------------------------


def kept(folder: Path) -> Kept:
    """Keep a file."""
    found = Kept(folder / "data_0.083deg_2024-07_abc.nc")
    with found.workshop() as workshop:
        fresh = workshop / found.file.name
        fresh.write_bytes(b"figures")
        found.keep(fresh, {"request": {"a": 1.5, "b": ["x"]}})
    return found


def test_a_kept_file_is_known_again_by_its_sidecar(tmp_path: Path) -> None:
    found = kept(tmp_path)
    facts = found.facts({"a": 1.5, "b": ["x"]})
    assert facts is not None
    assert (facts["sha256"], facts["bytes"]) == (file_hash(found.file), 7)
    assert facts["retrieved_utc"].endswith("+00:00")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "data_0.083deg_2024-07_abc.json",
        "data_0.083deg_2024-07_abc.nc",
    ]


def test_a_kept_file_that_is_not_what_its_sidecar_says_is_not_used(tmp_path: Path) -> None:
    found, request = kept(tmp_path), {"a": 1.5, "b": ["x"]}
    assert found.facts({"a": 2}) is None
    found.file.write_bytes(b"fugures")
    assert found.facts(request) is None
    found.file.unlink()
    assert found.facts(request) is None
    found = kept(tmp_path)
    for spoilt in ("", "[]", "{}", '{"request": ', json.dumps({"request": request})):
        found.sidecar.write_text(spoilt)
        assert found.facts(request) is None
    found.sidecar.unlink()
    assert found.facts(request) is None


def test_what_killed_runs_left_is_swept_and_what_others_work_in_is_not(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        left = [
            tmp_path / f"data_0.083deg.{dead.pid}.0123abcd.partial",
            tmp_path / f"data_0.083deg.{other.pid}.0123abcd.partial",
            tmp_path / f"data_0.083deg.{other.pid}.4567cdef.partial",
        ]
        for folder in left:
            folder.mkdir()
            (folder / "data.nc.XXXXXXXX").write_bytes(b"half")
        # Long before the process that has this number now.
        os.utime(left[2], (0, 0))
        with Kept(tmp_path / "data.nc").workshop() as workshop:
            assert [path.exists() for path in left] == [False, True, False]
            assert workshop.is_dir()
        assert sorted(tmp_path.iterdir()) == [left[1]]
        other.kill()
