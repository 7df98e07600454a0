"""No credential appears in a line of the log, whoever brings it there."""

from __future__ import annotations

import io
import json
from urllib.parse import quote

import pytest

from pipeline.cli.terminal import json_lines
from pipeline.sources.copernicus.client import PASSWORD, USERNAME

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
