"""The request of a page: every option of `renew go`, and a command line that is read alike."""

import shlex
from pathlib import Path

import typer
from hypothesis import given, strategies as st

from pipeline.cli.main import app
from pipeline.serve.plans import GivenFiles, PlanRequest, command_line

_TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
_COMMANDS = typer.main.get_command(app).commands  # type: ignore[attr-defined]


@given(start=_TEXT, goal=_TEXT, speed=_TEXT, via=st.lists(_TEXT, max_size=3))
def test_the_command_line_says_what_was_asked(
    start: str, goal: str, speed: str, via: list[str]
) -> None:
    asked = PlanRequest.model_validate({"start": start, "goal": goal, "speed": speed, "via": via})
    options = asked.options(GivenFiles(Path("unused")))
    program, name, *words = shlex.split(command_line(options, "a", Path("out"), offline=True))
    context = _COMMANDS[name].make_context(program, words, resilient_parsing=True)
    read = context.params
    assert list(read["positions"]) == [start, goal]
    assert (read["speed"] or "") == speed.strip()  # as every text is
    assert list(read["via"] or ()) == [one for one in via if one]
    assert (read["name"], read["output"], read["offline"]) == ("a", Path("out"), True)
