"""A night always reports to a service how it ended; that can't make it fail."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from pipeline.cli.main import app
from pipeline.machine.files import file_lock
from pipeline.nightly.cycles import LOCK
from tests.pipeline.nightly.nights import plane_night
from tests.pipeline.nightly.ping_service import Service


def renew(folder: Path, url: str, *options: str, **variables: str) -> Result:
    """Run the night in a folder."""
    arguments = ["--config", folder / "night.toml", "--output", folder / "out", *options]
    arguments += ["--ping", url] if url else []
    return CliRunner(env=variables).invoke(app, ["nightly", "run", *map(str, arguments)])


def test_a_night_that_ends_well_and_one_that_fails(tmp_path: Path, service: Service) -> None:
    """With workers of its own; other tests use those of the session."""
    plane_night(tmp_path, pairs=2, workers=1)
    assert renew(tmp_path, f"{service.url}/ID").exit_code == 0
    assert service.asked == ["/ID/start", "/ID"]

    (tmp_path / "pairs.csv").write_text("no pairs")
    assert renew(tmp_path, "", RENEW_PING=f"{service.url}/ID").exit_code == 2
    assert service.asked[2:] == ["/ID/start", "/ID/fail"]


def test_a_second_job_reports_nothing(tmp_path: Path, service: Service) -> None:
    plane_night(tmp_path, pairs=2)
    (tmp_path / "out").mkdir()
    with file_lock(tmp_path / "out" / LOCK) as held:
        assert held
        assert renew(tmp_path, f"{service.url}/ID").exit_code == 4
    assert service.asked == ["/ID/start"]


@pytest.mark.parametrize("url", ["http://127.0.0.1:9/0f5c3a1e-secret"])
def test_a_service_that_is_away_fails_nothing(tmp_path: Path, url: str, cluster: str) -> None:
    plane_night(tmp_path, pairs=2)
    result = renew(tmp_path, url, "--scheduler", cluster)
    assert result.exit_code == 0
    assert (tmp_path / "out" / "latest").is_symlink()
    notes = [json.loads(line) for line in result.stderr.splitlines()]
    said = [note["detail"] for note in notes if note["level"] == "warning"]
    failed = re.compile(r"--ping: reporting the \w+ to 127\.0\.0\.1:9 failed")
    assert sum(failed.search(one) is not None for one in said) == 2
    assert "secret" not in result.stderr


def test_an_invalid_address_is_refused_before_anything_is_done(tmp_path: Path) -> None:
    plane_night(tmp_path, pairs=2)
    result = renew(tmp_path, "ftp://host/secret")
    assert result.exit_code == 2
    assert "--ping is not a usable address" in result.stderr
    assert "secret" not in result.stderr
    assert not (tmp_path / "out").exists()
