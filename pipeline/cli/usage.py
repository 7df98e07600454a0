"""How commands read their arguments: all faults of usage at once, and help in whole words."""

import contextlib
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from typer.core import TyperCommand, TyperGroup

from pipeline.errors import RequestError, shortened
from pipeline.texts import clean

# Contexts, formatters and parameters have the type Any here: they are click's, or typer's own copy
# of click's, depending on typer's version.

# A minus and a digit or point, as in a negative number; no option begins with them.
_NEGATIVE = re.compile(r"-[\d.]")
# Stands for a hyphen while the help is wrapped: lines break at hyphens, but not at this character.
_NON_BREAKING_HYPHEN = "\N{NON-BREAKING HYPHEN}"


class _Parsed(NamedTuple):
    """Messages about unknown options, the values of the others, and extra arguments."""

    unknown: list[str]
    values: dict[str, Any]
    extra: list[str]
    are_arguments_known: bool


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
    """A command that names all faults of its arguments at once."""

    def check_request(self, values: dict[str, Any]) -> None:
        """Raise RequestError with the faults of the request; `values` are its arguments by name."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - see above
        """Parse the arguments; if that fails, look for further faults."""
        try:
            return super().parse_args(ctx, list(args))
        except Exception as error:
            faults = list(dict.fromkeys(self._faults(ctx, args))) if _is_of_usage(error) else []
            if len(faults) < 2:
                raise
            ctx.fail("\nError: ".join(faults))
            raise  # never reached: `fail` raises an error of usage

    def _faults(self, ctx: Any, args: list[str]) -> Iterator[str]:  # noqa: ANN401 - see above
        """Yield a message for each fault of usage, and then for each of the request itself."""
        unknown, values, extra, are_arguments_known = self._parsed(ctx, args)
        yield from unknown
        for one in self.get_params(ctx):
            is_known = are_arguments_known or one.param_type_name != "argument"
            if is_known and not one.is_eager:
                try:
                    one.handle_parse_result(ctx, values, [])
                except Exception as error:
                    if not _is_of_usage(error):
                        raise
                    yield _message(error)
        if extra and are_arguments_known:
            yield shortened(f"Got unexpected extra argument(s) ({' '.join(extra)})")
        try:
            self.check_request(ctx.params)
        except RequestError as error:
            yield from error.faults

    def _parsed(self, ctx: Any, args: list[str]) -> _Parsed:  # noqa: ANN401 - see above
        """Parse the arguments; an unknown option is read as the known one that it resembles."""
        messages: list[str] = []
        rest, are_arguments_known = list(args), True
        while True:
            try:
                values, extra, _ = self.make_parser(ctx).parse_args(args=list(rest))
            except Exception as error:
                if not _is_of_usage(error):
                    raise
                messages.append(_message(error))
                name = str(getattr(error, "option_name", ""))
                at = next((i for i, one in enumerate(rest) if one.partition("=")[0] == name), None)
                if at is None:
                    return _Parsed(messages, {}, [], are_arguments_known=False)
                alike = getattr(error, "possibilities", None) or []
                is_before_word = at + 1 < len(rest) and not rest[at + 1].startswith("-")
                # The next word may be the value of an unknown option that resembles no known one.
                are_arguments_known &= bool(alike) or not is_before_word
                meant = alike[:1] if is_before_word or "=" in rest[at] else []
                rest[at : at + 1] = [one + rest[at][len(name) :] for one in meant]
            else:
                return _Parsed(messages, values, extra, are_arguments_known)


class GroupedCommand(Command):
    """A command with groups of options, which parses negative numbers as arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - see above
        """Parse the arguments; a space before a minus hides it from the option parser."""
        return super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - see above
        """Write arguments and options in groups, in the order in which the groups first occur."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is not None:
                is_argument = one.param_type_name == "argument"
                group = getattr(one, "rich_help_panel", None)
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
    """Shorten messages about invalid arguments."""
    try:
        yield
    except Exception as error:
        if _is_of_usage(error):
            lines = error.message.splitlines()  # type: ignore[attr-defined]
            error.message = "\n".join(map(shortened, lines))  # type: ignore[attr-defined]
        raise


def _is_of_usage(error: Exception) -> bool:
    """Whether an error is about invalid arguments; its class depends on typer's version."""
    return hasattr(error, "format_message") and isinstance(getattr(error, "message", None), str)


def _message(error: Exception) -> str:
    """Return an error's message on one line."""
    return clean(shortened(error.format_message()))  # type: ignore[attr-defined]
