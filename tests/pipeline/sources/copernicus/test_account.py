"""Credentials do not appear in messages."""

from __future__ import annotations

import base64
import configparser
import os
from pathlib import Path

import pytest

from pipeline.sources.copernicus.client import PASSWORD, USERNAME, without_secrets


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Give the client's own folder, empty, without credentials in the environment."""
    for name in list(os.environ):
        if name.startswith("COPERNICUS"):
            monkeypatch.delenv(name)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path))
    folder = tmp_path / ".copernicusmarine"
    folder.mkdir()
    return folder


def test_credentials_are_removed_from_messages(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(USERNAME, "captain")
    monkeypatch.setenv(PASSWORD, "captain-nemo")
    stored = "[credentials]\nusername = ahab\npassword = moby=dick\n"
    (home / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    text = without_secrets("login captain-nemo of captain or ahab with moby=dick failed")
    assert text == "login *** of *** or *** with *** failed"


def test_credentials_are_removed_from_addresses_as_they_are_encoded_there(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    del home
    monkeypatch.setenv(USERNAME, "nemo@sea.org")
    monkeypatch.setenv(PASSWORD, "p&ss word")
    text = without_secrets(
        "https://s3/uo/1.2?x-cop-client=a&x-cop-user=nemo_of_the_service&b=c, form "
        "username=nemo%40sea.org&password=p%26ss+word, proxy http://me:secret@proxy:3128/"
    )
    assert text == (
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
def test_errors_of_a_damaged_credentials_file_show_nothing_of_it(home: Path, stored: str) -> None:
    (home / ".copernicusmarine-credentials").write_bytes(base64.b64encode(stored.encode()))
    try:
        configparser.RawConfigParser().read_string(stored)
        error = stored
    except configparser.Error as raised:
        error = str(raised)
    assert "ahab" in error or "moby" in error
    text = without_secrets(error)
    assert "ahab" not in text
    assert "moby-dick" not in text
