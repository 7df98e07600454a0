"""Tables of options: dataclasses whose fields `options.toml` describes.

The command line, the page's form with its HTTP interface, QGIS's tools and Python's functions are
made from the fields of one dataclass, and `read` makes an instance from what any of them was given.
It is no pydantic model, because the command line is made from it and has to start without pydantic,
which takes as long to load as all the rest.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, TypeVar

from pipeline.errors import RequestError, refuse_any
from pipeline.machine.paths import folder_to_write
from pipeline.texts import table_beside

Asker = Literal["command", "page", "python"]
Kind = Literal["text", "place", "time", "file", "source", "folder", "flag", "number"]
CatalogueSection = Literal["scenarios", "vessels", "stations", "sources"]
_Value = TypeVar("_Value")
_Table = TypeVar("_Table")


@dataclass(frozen=True, kw_only=True)
class Option:
    """An option of a command, a form or a function, besides its type.

    Parameters
    ----------
    group : heading under which the option stands in help and form; "" for an argument.
    help : what it does; "{depart}" stands for another option as the asker writes it.
    label, example : its name in a form, by default made of `name`; and an example, or what is
        chosen if nothing is.
    read : makes the typed value from a text; a value that is typed already stays. It raises
        RequestError, or ValueError with a fault as each argument; the option's name is added.
    kind : what is given: a "source" is a name of the catalogue or a file, a "place" a position.
    field, default, is_required : the field, its default, and whether it has none.
    name : its name on the command line and in JSON, if it is not the field's name, which is the
        argument in Python.
    metavar : what stands for its value in the help of the command line.
    most : largest number of values; 0 for an option that takes a single value.
    section : section of the catalogue with the names to choose from.
    layer : geometry of the layer that QGIS offers for a file.
    is_of_run : true if it says how a job is run, not what is planned: a server sets it for all
        plans.
    """

    field: str
    default: Any
    is_required: bool
    group: str
    help: str
    label: str = ""
    example: str = ""
    read: Callable[[Any], Any] = lambda value: value
    kind: Kind = "text"
    name: str = ""
    metavar: str = ""
    most: int = 0
    section: CatalogueSection | Literal[""] = ""
    layer: Literal["", "polygon", "point"] = ""
    is_of_run: bool = False

    @property
    def key(self) -> str:
        """The option's name in JSON."""
        return self.name or self.field

    @property
    def title(self) -> str:
        """The option's name in a form."""
        return self.label or self.key.replace("_", " ").capitalize()

    @property
    def typed(self) -> str:
        """The option as it is typed on the command line."""
        return f"--{self.key.replace('_', '-')}" if self.group else self.metavar or self.key

    def spelled(self, asker: Asker) -> str:
        """Return the option as an asker writes it: `--month`, 'Months' in a form, or months."""
        if asker == "command":
            return self.typed
        return self.field if asker == "python" else f"'{self.title}'"

    def words(self, value: Any) -> list[str]:  # noqa: ANN401 - whatever the option takes
        """Return the option with its value as they are typed on the command line."""
        if self.kind == "flag":
            return [self.typed] if value else []
        values = value if self.most else [value]
        return [word for given in values or () if given for word in (self.typed, str(given))]


_ABOUT = table_beside(__file__, "options.toml")


def options(table: type[Any]) -> tuple[Option, ...]:
    """Return the options of a table in their order."""
    listed = []
    for field in fields(table):
        readers = getattr(table.__annotations__[field.name], "__metadata__", ())
        is_required = field.default is MISSING
        listed.append(
            Option(
                field=field.name,
                default=None if is_required else field.default,
                is_required=is_required,
                **_ABOUT[table.__name__][field.name],
                **({"read": readers[0]} if readers else {}),
            )
        )
    return tuple(listed)


def spelling(table: type[Any], asker: Asker) -> SimpleNamespace:
    """Return how an asker writes each option, by its field."""
    return SimpleNamespace(**{option.field: option.spelled(asker) for option in options(table)})


def help_text(option: Option, at: SimpleNamespace) -> str:
    """Return what an option does, in an asker's spelling."""
    return option.help.format_map(vars(at))


def read(
    table: type[_Table],
    given: Mapping[str, Any],
    asker: Asker,
    rules: Callable[
        [SimpleNamespace, SimpleNamespace, SimpleNamespace], Iterable[str]
    ] = lambda *_: (),
    known: Sequence[str] = (),
) -> _Table:
    """Read what was given for the options of a table, by their fields or their names.

    Empty values are left out. `rules` yields the faults between options: it is called with the
    values that could be read and with all values as they were given, None for an option that was
    left out, and with the spelling. `known` are faults found before; a required value may then be
    None. Raises RequestError with a line for each fault, with its option as the asker writes it.
    """
    at = spelling(table, asker)
    asked: dict[str, Any] = {}
    values: dict[str, Any] = {}
    faults = [*known]
    for option in options(table):
        value = given.get(option.field, given.get(option.key))
        if value is None or (value in ("", (), []) and not option.is_required):
            continue
        asked[option.field] = value
        try:
            values[option.field] = option.read(value)
        except (ValueError, RequestError) as error:
            place = getattr(at, option.field)
            lines = (line.lstrip() for line in _faults_of(error))
            faults += [f"{place}{'' if line.startswith(':') else ' '}{line}" for line in lines]
    blank = {option.field: None for option in options(table)}
    faults += rules(SimpleNamespace(**blank | values), SimpleNamespace(**blank | asked), at)
    refuse_any(faults)
    return table(**values)


def each(reader: Callable[[Any], _Value]) -> Callable[[Any], tuple[_Value, ...]]:
    """Return a reader of several values, which names the faults of all."""

    def read_all(texts: Iterable[Any]) -> tuple[_Value, ...]:
        values: list[_Value] = []
        faults: list[str] = []
        for text in texts:
            try:
                values.append(reader(text))
            except (ValueError, RequestError) as error:
                faults += _faults_of(error)
        if faults:
            raise ValueError(*faults)
        return tuple(values)

    return read_all


def _faults_of(error: ValueError | RequestError) -> tuple[str, ...]:
    return error.faults if isinstance(error, RequestError) else tuple(map(str, error.args))


def read_folder(path: str | Path) -> Path:
    """Read a folder to write to."""
    return folder_to_write(Path(path), "")
