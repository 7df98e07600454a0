"""Every place that states the version agrees."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib

import pytest
import yaml

import renew
from tests.conftest import ROOT


def test_citation_and_changelog_have_the_version_and_its_date() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    releases = re.findall(
        r"^## \[(\d+\.\d+\.\d+)\] - (\S+)$",
        (ROOT / "CHANGELOG.md").read_text("utf-8"),
        re.MULTILINE,
    )
    assert releases[0] == (renew.__version__, str(citation["date-released"]))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert citation["version"] == project["version"] == renew.__version__


def test_a_tag_of_this_commit_is_the_version() -> None:
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("needs the repository")
    command = [git, "tag", "--points-at", "HEAD", "--list", "v*"]
    tags = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert set(tags.split()) <= {f"v{renew.__version__}"}
