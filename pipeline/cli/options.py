"""Arguments and options of the commands: made from tables of options, or annotated types."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import Option, help_text, options, spelling

_Command = TypeVar("_Command", bound=Callable[..., None])
_TYPES: dict[str, type[Any]] = {
    "file": Path,
    "folder": Path,
    "flag": bool,
    "number": float,
    "count": int,
}


def with_options(table: type[Any], *, without: tuple[str, ...] = ()) -> Callable[..., Any]:
    """Give a command the options of a table, beside its own, as keyword arguments.

    `without` names the fields that the command asks for in its own way.
    """

    def decorated(command: _Command) -> _Command:
        signature = inspect.signature(command)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        first = [one for one in own if one.default is one.empty]
        made = [_parameter(table, one) for one in options(table) if one.field not in without]
        asked = [*first, *made, *(one for one in own if one not in first)]
        command.__signature__ = signature.replace(parameters=asked)  # type: ignore[attr-defined]
        return command

    return decorated


def _parameter(table: type[Any], one: Option) -> inspect.Parameter:
    """Return an option as the parameter of a command."""
    kind = _TYPES.get(one.kind, str)
    default = inspect.Parameter.empty if one.is_required else one.default or None
    if one.kind == "flag":
        default = False
    annotation: Any = list[kind] if one.most else kind if default else kind | None  # type: ignore[valid-type]
    return inspect.Parameter(
        one.key,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[annotation if not one.is_required else kind, _info(table, one)],
    )


def _info(table: type[Any], one: Option) -> Any:  # noqa: ANN401 - typer's argument or option
    """Return what typer is told of an option."""
    known: dict[str, Any] = {
        "help": help_text(one, spelling(table, "command")),
        "metavar": one.metavar or None,
        "min": one.least,
        "max": one.limit,
        "autocompletion": known_names(one.section) if one.section else None,
    }
    if not one.group:
        return typer.Argument(**known)
    return typer.Option(*filter(None, (one.typed, one.short)), rich_help_panel=one.group, **known)


def known_names(section: str) -> Callable[[str], list[str]]:
    """Return a function that completes names of a catalogue section in a shell."""

    def completed(incomplete: str) -> list[str]:
        from pipeline.scenario import catalogue

        known = catalogue.stations() if section == "stations" else catalogue.names(section)  # type: ignore[arg-type]
        return [name for name in known if name.startswith(incomplete)]

    return completed


def _as_for_voyages(field: str) -> Any:  # noqa: ANN401 - typer's option
    """Return an option of other commands that means what it means for a voyage."""
    (one,) = (one for one in options(VoyageRequest) if one.field == field)
    return _info(VoyageRequest, one)


# --- of several commands ---

Scenario = Annotated[
    str,
    typer.Argument(
        help="A name in the catalogue (`renew list`) or the path of a TOML file.",
        autocompletion=known_names("scenarios"),
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        rich_help_panel="Output",
        help="Print errors only: no progress, no notes, and no table at the end.",
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", rich_help_panel="Output", help="Print one JSON object in place of the table."
    ),
]
JsonOnly = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Output = Annotated[Path, _as_for_voyages("output")]
Offline = Annotated[bool, _as_for_voyages("offline")]
Charts = Annotated[Path | None, _as_for_voyages("charts")]
Currents = Annotated[list[str] | None, _as_for_voyages("currents")]
ExplainGap = Annotated[bool, _as_for_voyages("explain_gap")]
Strict = Annotated[bool, _as_for_voyages("strict")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler, such as tcp://host:8786.")
]
