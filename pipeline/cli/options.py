"""The options of commands, and the classes of commands that parse them and write their help.

Options are made from tables: those of a voyage, and `options.toml`.
"""

import contextlib
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_origin

import typer
from typer.core import TyperCommand, TyperGroup

from pipeline.cli.failures import reported_errors
from pipeline.errors import shortened
from pipeline.texts import table_beside
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import CatalogueSection, Option, help_text, options, spelling

_Command = TypeVar("_Command", bound=Callable[..., None])
group = partial(typer.Typer, no_args_is_help=True, rich_markup_mode=None)
"""Makes a group of commands."""
_TYPES: dict[str, type[Any]] = {"file": Path, "folder": Path, "flag": bool, "number": float}


def with_options(table: type[Any], *, without: tuple[str, ...] = ()) -> Callable[..., Any]:
    """Give a command the options of a table, beside its own, as keyword arguments.

    `without` names the fields that the command asks for in its own way.
    """

    def decorated(command: _Command) -> _Command:
        signature = inspect.signature(command)
        given = signature.parameters.values()
        own = [parameter for parameter in given if parameter.kind is not parameter.VAR_KEYWORD]
        first = [parameter for parameter in own if parameter.default is parameter.empty]
        asked = [option for option in options(table) if option.field not in without]
        made = [_parameter(table, option) for option in asked]
        parameters = [*first, *made, *(parameter for parameter in own if parameter not in first)]
        command.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        return command

    return decorated


def _parameter(table: type[Any], option: Option) -> inspect.Parameter:
    """Return an option as the parameter of a command."""
    kind = _TYPES.get(option.kind, str)
    default = inspect.Parameter.empty if option.is_required else option.default or None
    if option.kind == "flag":
        default = False
    annotation: Any = list[kind] if option.most else kind if default else kind | None  # type: ignore[valid-type]
    return inspect.Parameter(
        option.key,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[annotation if not option.is_required else kind, _info(table, option)],
    )


def _info(table: type[Any], option: Option) -> Any:  # noqa: ANN401 - typer's argument or option
    """Return what typer has to know of an option."""
    known: dict[str, Any] = {
        "help": help_text(option, spelling(table, "command")),
        "metavar": option.metavar or None,
        "autocompletion": known_names(option.section) if option.section else None,
    }
    if not option.group:
        return typer.Argument(**known)
    return typer.Option(option.typed, rich_help_panel=option.group, **known)


def known_names(section: CatalogueSection) -> Callable[[str], list[str]]:
    """Return a function that completes names of a catalogue section in a shell."""

    def completed(incomplete: str) -> list[str]:
        from pipeline.scenario import catalogue

        return [name for name in catalogue.choices(section) if name.startswith(incomplete)]

    return completed


_ABOUT = table_beside(__file__, "options.toml")


def command(app: typer.Typer, name: str) -> Callable[[_Command], _Command]:
    """Make a function a command, whose last word is that of `name`, as `options.toml` describes.

    Its errors are lines on standard error and an exit code.
    """
    group, _, _ = name.partition(" ")
    about = {**_ABOUT["all"], **_ABOUT.get(group, {})}

    def decorated(function: _Command) -> _Command:
        signature = inspect.signature(function)
        parameters = [
            one
            if get_origin(one.annotation) is Annotated or one.kind is one.VAR_KEYWORD
            else one.replace(annotation=Annotated[one.annotation, _described(one.name, about)])
            for one in signature.parameters.values()
        ]
        function.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        reported = reported_errors()(function)
        app.command(name.rpartition(" ")[2], cls=Command)(reported)
        return reported

    return decorated


def _described(name: str, about: Mapping[str, Any]) -> Any:  # noqa: ANN401 - typer's argument or option
    """Return what typer has to know of a parameter: one of the given, or of a voyage."""
    if name not in about:
        (option,) = (option for option in options(VoyageRequest) if option.field == name)
        return _info(VoyageRequest, option)
    own = dict(about[name])
    is_argument, flags = own.pop("is_argument", False), own.pop("flags", ())
    if section := own.pop("complete", ""):
        own["autocompletion"] = known_names(section)
    return typer.Argument(**own) if is_argument else typer.Option(*flags, **own)


# --- parsing and help ---

# Contexts, formatters and parameters have the type Any here: they are click's, or typer's own copy
# of click's, depending on typer's version.

# A minus and a digit or point, as in a negative number; no option begins with them.
_NEGATIVE = re.compile(r"-[\d.]")
# Stands for a hyphen while the help is wrapped: lines break at hyphens, but not at this character.
_NON_BREAKING_HYPHEN = "\N{NON-BREAKING HYPHEN}"


class _WholeWords:
    """A command whose help breaks lines between words, not at the hyphens of options."""

    def get_help(self, ctx: Any) -> str:  # noqa: ANN401 - see above
        """Return the help."""
        commands = getattr(self, "commands", {}).values()
        for described in (self, *self.params, *commands):  # type: ignore[attr-defined]
            described.help = (described.help or "").replace("-", _NON_BREAKING_HYPHEN)
        text: str = super().get_help(ctx)  # type: ignore[misc]
        return text.replace(_NON_BREAKING_HYPHEN, "-")


class Command(_WholeWords, TyperCommand):
    """A command with groups of options, which parses negative numbers as arguments."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - see above
        """Parse the arguments; a space before a minus hides it from the option parser."""
        rest = super().parse_args(ctx, [f" {a}" if _NEGATIVE.match(a) else a for a in args])
        texts = {name: one for name, one in ctx.params.items() if isinstance(one, str)}
        ctx.params |= {name: one.strip() for name, one in texts.items()}
        return rest

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
                    (
                        name,
                        " ".join((command.help or "").split("\n\n", 1)[0].split()).replace(
                            "-", _NON_BREAKING_HYPHEN
                        ),
                    )
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
