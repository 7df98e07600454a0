"""How commands read their arguments, and how their help is written: lines break between words."""

import contextlib
import re
from collections.abc import Iterator
from typing import Any

from typer.core import TyperCommand, TyperGroup

from pipeline.errors import shortened

# Contexts, formatters and parameters have the type Any here: they are click's, or typer's own copy
# of click's, depending on typer's version.

# A minus and a digit or point, as in a negative number; no option begins with them.
_NEGATIVE = re.compile(r"-[\d.]")
# Stands for a hyphen while the help is wrapped: lines break at hyphens, but not at this character.
_NON_BREAKING_HYPHEN = "\N{NON-BREAKING HYPHEN}"


class _WholeWords:
    """A command whose help breaks lines between words only."""

    def get_help(self, ctx: Any) -> str:  # noqa: ANN401 - see above
        """Return the help; no line breaks at the hyphen of an option."""

        class Formatter(ctx.formatter_class):  # type: ignore[misc]
            """Replaces hyphens before it wraps a text."""

            def write_text(self, text: str) -> None:
                """Write a paragraph."""
                super().write_text(text.replace("-", _NON_BREAKING_HYPHEN))

            def write_dl(self, rows: Any, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - see above
                """Write a list of names with their meanings."""
                unbroken = [(name, text.replace("-", _NON_BREAKING_HYPHEN)) for name, text in rows]
                super().write_dl(unbroken, *args, **kwargs)

        ctx.formatter_class = Formatter
        text: str = super().get_help(ctx)  # type: ignore[misc]
        return text.replace(_NON_BREAKING_HYPHEN, "-")


class Command(_WholeWords, TyperCommand):
    """A command with whole words in its help."""


class GroupedCommand(Command):
    """A command with groups of options, which parses negative numbers as arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - see above
        """Parse the arguments; a space before a minus hides it from the option parser."""
        return super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - see above
        """Write arguments and options in groups, in the order in which the groups first occur."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if (record := parameter.get_help_record(ctx)) is not None:
                is_argument = parameter.param_type_name == "argument"
                group = getattr(parameter, "rich_help_panel", None)
                name = "Arguments" if is_argument else group or "Other options"
                groups.setdefault(name, []).append(record)
        for name, records in groups.items():
            with formatter.section(name):
                formatter.write_dl(records)


class BriefRefusals(_WholeWords, TyperGroup):
    """A command group with whole sentences in its help, and short arguments in its refusals."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - see above
        """List the commands with the whole first paragraph of each one's help."""
        commands = ((name, self.get_command(ctx, name)) for name in self.list_commands(ctx))
        with formatter.section("Commands"):
            formatter.write_dl(
                [
                    (name, " ".join((command.help or "").split("\n\n", 1)[0].split()))
                    for name, command in commands
                    if command is not None and not command.hidden
                ]
            )

    def make_context(self, *args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - see above
        """Parse the arguments before the command."""
        with _brief_refusals():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - see above
        """Parse the command's own arguments, and run it."""
        with _brief_refusals():
            return super().invoke(ctx)


@contextlib.contextmanager
def _brief_refusals() -> Iterator[None]:
    """Shorten messages about invalid arguments; their class depends on typer's version."""
    try:
        yield
    except Exception as error:
        message = getattr(error, "message", None)
        if hasattr(error, "format_message") and isinstance(message, str):
            error.message = "\n".join(map(shortened, message.splitlines()))  # type: ignore[attr-defined]
        raise
