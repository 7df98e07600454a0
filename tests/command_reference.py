"""The reference of commands and their options, from the command line itself: `make reference`.

`python -m tests.command_reference` puts it between the marks in docs/reference/command-line.md.
"""

from __future__ import annotations

from collections.abc import Iterator

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from pipeline.cli.main import app
from tests.conftest import ROOT

PAGE = ROOT / "docs" / "reference" / "command-line.md"
BEGIN, END = "<!-- commands: make reference -->\n", "<!-- end of commands -->"


def commands() -> dict[str, TyperCommand]:
    """Every command that does something, by what is typed: "renew nightly run"."""
    return dict(_commands("renew", typer.main.get_command(app)))


def _commands(name: str, command: object) -> Iterator[tuple[str, TyperCommand]]:
    """Yield a command, or all those in a group."""
    if isinstance(command, TyperGroup):
        for inner, one in command.commands.items():
            yield from _commands(f"{name} {inner}", one)
    elif isinstance(command, TyperCommand):
        yield name, command


def options(command: TyperCommand) -> dict[str, TyperOption]:
    """A command's options by their long names; those that are switched off have two."""
    return {
        name: one
        for one in command.params
        if isinstance(one, TyperOption) and not one.hidden
        for name in (*one.opts, *one.secondary_opts)
        if name.startswith("--")
    }


def text() -> str:
    """All commands as Markdown: how each is typed, what it does, and its options."""
    return "\n".join(_section(name, command) for name, command in sorted(commands().items()))


def _section(name: str, command: TyperCommand) -> str:
    """One command."""
    arguments = [str(one.metavar or one.name).upper() for one in command.params
                 if isinstance(one, TyperArgument)]  # fmt: skip
    typed = " ".join((name, *arguments))
    what = " ".join((command.help or "").split("\n\n", 1)[0].split())
    rows = [
        f"| `{option}` | {_cell(one.help or '')}{_default(one)} |"
        for option, one in options(command).items()
    ]
    table = ["", "| option | what it does |", "|---|---|", *rows] if rows else []
    return "\n".join((f"### `{typed}`", "", _cell(what), *table, ""))


def _cell(words: str) -> str:
    """Text that stays in one cell of a Markdown table."""
    return " ".join(words.split()).replace("|", "\\|").replace("<", "&lt;")


def _default(option: TyperOption) -> str:
    """An option's default, where it has one that is worth a word."""
    value = option.default
    shown = not option.is_flag and value not in (None, "", (), []) and not callable(value)
    return f" Left out, `{getattr(value, 'value', value)}`." if shown else ""


def with_commands(page: str, new: str) -> str:
    """Return the page with a new reference between its marks."""
    return between(page, BEGIN, new, END)


def between(page: str, begin: str, new: str, end: str) -> str:
    """Return the page with new text between its marks `begin` and `end`."""
    before, rest = page.split(begin)
    return f"{before}{begin}{new}{end}{rest.split(end, 1)[1]}"


if __name__ == "__main__":
    PAGE.write_text(with_commands(PAGE.read_text("utf-8"), text()), encoding="utf-8")
