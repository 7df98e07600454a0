"""Lines on a terminal: as long as it is wide, and broken between words only."""

import io
import json
import os
import pty
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from urllib.parse import quote

import pytest
from typer.testing import CliRunner

from pipeline.cli import terminal
from pipeline.cli.main import app
from pipeline.cli.terminal import json_lines, table, wrapped
from pipeline.sources.copernicus.client import PASSWORD, USERNAME

ROWS = (
    ("season", "rank", "way", "fuel"),
    ("july", "1", "west of Palawan and south-east of Bugsuk", "695.6"),
    ("july", "2", "east of Palawan", "+4.1 %"),
)


def test_a_wide_table_wraps_its_way() -> None:
    assert table(ROWS, 3, None) == table(ROWS, 3, 200)
    lines = table(ROWS, 3, 44)
    assert max(map(len, lines)) <= 44
    assert lines == [
        "season  rank  way                       fuel",
        "july    1     west of Palawan and      695.6",
        "              south-east of Bugsuk",
        "july    2     east of Palawan         +4.1 %",
    ]


def test_lines_break_between_words() -> None:
    text = "- the narrowest place needs --turning-circle, or a word-that-is-long\n\nend"
    assert wrapped(text, None) == text
    assert wrapped(text, 30).splitlines() == [
        "- the narrowest place needs",
        "  --turning-circle, or a",
        "  word-that-is-long",
        "",
        "end",
    ]


@pytest.mark.parametrize("columns", [60, 100])
def test_an_error_fits_the_terminal(columns: int, tmp_path: Path) -> None:
    """The program's standard error is a terminal of so many columns."""
    controller, terminal = pty.openpty()
    script = textwrap.dedent(
        """
        from pipeline.cli.main import app
        app(["run", "palawan-saeson", "--currents", "nowhere"])
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        stderr=terminal,
        stdout=subprocess.DEVNULL,
        cwd=tmp_path,
        env={**os.environ, "COLUMNS": str(columns)},
        check=False,
        timeout=120,
    )
    os.close(terminal)
    lines = os.read(controller, 10_000).decode().splitlines()
    os.close(controller)
    assert done.returncode == 2
    assert lines[0].startswith("error: no scenario 'palawan-saeson'")
    assert max(map(len, lines)) <= columns
    assert len(lines) == (2 if columns == 60 else 1)


# --- No credential appears in a line of the log, whoever brings it there ---


# With characters that JSON and addresses each spell in their own way.
SECRETS = ("sailor@sea", 'p"a\\ss/wörd&')


@pytest.fixture(autouse=True)
def account(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set an account."""
    monkeypatch.setenv(USERNAME, SECRETS[0])
    monkeypatch.setenv(PASSWORD, SECRETS[1])


@pytest.mark.parametrize("secret", SECRETS)
def test_credentials_are_hidden_wherever_they_stand(secret: str) -> None:
    stream = io.StringIO()
    log = json_lines(stream).bind(bound=f"as {secret}")
    log.error(
        f"refused {secret}",  # noqa: G004 - structlog takes no arguments for a message
        detail=f"for {secret!s}.",
        nested={"of": [secret, (f"https://host/?login={quote(secret)}", 3)]},
        number=7,
    )
    (line,) = stream.getvalue().splitlines()
    fields = json.loads(line)
    assert fields["event"] == "refused ***"
    assert fields["bound"] == "as ***"
    assert fields["detail"] == "for ***."
    assert fields["nested"] == {"of": ["***", ["https://host/?login=***", 3]]}
    assert (fields["number"], fields["level"]) == (7, "error")
    assert secret not in line
    assert json.dumps(secret)[1:-1] not in line


def test_a_proxys_password_is_hidden_although_it_is_no_known_secret() -> None:
    stream = io.StringIO()
    json_lines(stream).info("working", detail="through http://me:opensesame@proxy:3128/")
    assert "opensesame" not in stream.getvalue()
    assert json.loads(stream.getvalue())["detail"] == "through http://***@proxy:3128/"


# --- A command without stages says now and then that it is at work ---


class _Nothing(str):
    """What each of the slow functions may return: no findings, no text, and the path of a file."""

    __slots__ = ()

    def relative_to(self, _: object) -> str:
        return self


def _slow(*_: object, **__: object) -> str:
    """Take a while, and find nothing."""
    time.sleep(0.35)
    return _Nothing()


@pytest.mark.gate_share(3)
@pytest.mark.parametrize(
    ("arguments", "slow"),
    [
        (["check", "single-gyre"], "pipeline.stages.region.endpoints_on_land"),
        (["nightly", "check"], "pipeline.nightly.cases.pairs_on_land"),
        (["clean"], "pipeline.cli.upkeep.freed"),
        (["warm"], "pipeline.cli.upkeep.warm"),
        (["doctor", "--offline"], "pipeline.cli.upkeep.examine"),
    ],
)
def test_a_slow_command_says_that_it_is_at_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], slow: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(terminal, "_PAUSE_S", 0.1)
    monkeypatch.setattr(slow, _slow)
    threads = threading.active_count()
    ended = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert ended.exit_code == 0
    assert 1 <= ended.stderr.count("still at work, after ") <= 4
    assert threading.active_count() == threads
