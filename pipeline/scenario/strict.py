"""Strict models of tables in TOML, types of their values, and the messages about their faults.

The last sentence of a key's description is the remedy: an error message about the key ends in it.
Each of pydantic's errors becomes a line that states the value, the limit and the remedy.
"""

import difflib
import inspect
import itertools
import json
import tomllib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from pipeline.errors import Fault, RequestError
from pipeline.machine.paths import resolved, shown as shown_path, unusable_reason
from pipeline.texts import clean, in_years

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

ModelT = TypeVar("ModelT", bound=BaseModel)


class RemediedError(ValueError):
    """A refusal that has its own remedy: the one in the key's description is not added."""


@cache
def _table(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Return what `keys.toml` in a folder says of the keys of its models."""
    file = folder / "keys.toml"
    return tomllib.loads(file.read_text(encoding="utf-8")) if file.exists() else {}


def _about(model: type[BaseModel]) -> dict[str, dict[str, Any]]:
    """Return what is said of the keys of a model, its own and those that it inherits."""
    about = dict[str, dict[str, Any]]()
    for owner in reversed(model.__mro__):
        if issubclass(owner, StrictModel):
            about |= _table(Path(inspect.getfile(owner)).parent).get(owner.__name__, {})
    return about


def descriptions(model: type[BaseModel]) -> dict[str, str]:
    """Return the descriptions of a model's keys."""
    fields, about = model.model_fields.items(), _about(model)
    known = {field.alias or name: field.description or "" for name, field in fields}
    known |= {key: own["text"] for key, own in about.items() if "text" in own}
    return {key: text for key, text in known.items() if text}


def _describe(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """Put descriptions, examples and units of keys into a model's schema."""
    for key, text in descriptions(model).items():
        schema["properties"][key]["description"] = text
    for key, own in _about(model).items():
        schema["properties"][key] |= {name: own[name] for name in own if name != "text"}


class DiskPath(str):
    """A path. It is not cleaned, because a name may have two blanks, or an accent on its own."""

    __slots__ = ()


# A path that the reader of the table only passes on.
PathAsGiven = Annotated[str, AfterValidator(DiskPath)]


def cleaned(value: object) -> object:
    """Clean a text of a table; paths and other values stay."""
    return clean(value) if isinstance(value, str) and not isinstance(value, DiskPath) else value


class StrictModel(BaseModel):
    """A frozen table that refuses unknown keys and numbers that are not finite.

    The description of a key, in the reference, in the schema and in messages, is in `keys.toml`
    beside the model: to look for docstrings in the source takes 0.07 s at each start.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, json_schema_extra=_describe
    )
    _clean_texts = field_validator("*")(cleaned)


# A name becomes the name of folders and files: only characters that every file system and shell
# accepts.
Name = Annotated[str, Field(pattern=r"^[a-z0-9]([a-z0-9_-]{0,62}[a-z0-9])?$")]
Number = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Longitude = Annotated[Number, Field(ge=-180, le=360)]
Latitude = Annotated[Number, Field(ge=-90, le=90)]
LonLat = tuple[Longitude, Latitude]
LonLatBox = tuple[Longitude, Latitude, Longitude, Latitude]
# Limits of a coordinate, degrees or metres: larger than any plane, but squares don't overflow.
Coordinate = Annotated[Number, Field(ge=-1e9, le=1e9)]
Point = tuple[Coordinate, Coordinate]


def _simple_polygon(corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """Refuse a polygon that crosses itself or has no area."""
    import shapely

    ring = shapely.Polygon(corners)
    if not ring.is_valid or ring.area == 0:
        reason = shapely.is_valid_reason(ring) if not ring.is_valid else "it has no area"
        raise ValueError(f"is not a simple polygon: {plain_reason(reason)}")
    return corners


def plain_reason(reason: str) -> str:
    """Spell GEOS's reason plainly: "Self-intersection[1 9]" as "it crosses itself at 1, 9"."""
    kind, _, where = reason.partition("[")
    place = ", ".join(f"{float(number):g}" for number in where.rstrip("]").split())
    words = "it crosses itself" if "intersection" in kind.lower() else kind
    return f"{words} at {place}" if place else words


def looks_like_path(text: str) -> bool:
    """Whether a source is given by its path: catalogue names have no slashes, points or tildes."""
    return bool(set(text) & set("/\\.~"))


def usable_path(text: str, info: ValidationInfo) -> str:
    """Refuse a text that can't be a path; make it absolute where the context names a `folder`."""
    if reason := unusable_reason(text):
        raise RemediedError(f"= '{shown_path(text)}' {reason}")
    if not (text and info.context):
        return DiskPath(text)
    is_relative = not text.startswith(("~", "/"))
    return DiskPath(resolved(info.context["folder"] / text if is_relative else text, "scenario"))


def _written(given: object) -> object:
    """Refuse a number, which would be taken for seconds since 1970."""
    if str(given).lstrip("-").replace(".", "").isdecimal():
        raise ValueError(f"= {given} is a number")
    return given


Moment = Annotated[AwareDatetime, BeforeValidator(_written), AfterValidator(in_years)]
PathText = Annotated[str, AfterValidator(usable_path)]
_SimpleRing = AfterValidator(_simple_polygon)
Corners = Annotated[tuple[Point, ...], Field(min_length=3), _SimpleRing]
LonLatRing = Annotated[tuple[LonLat, ...], Field(min_length=3), _SimpleRing]


# Maximum length of a value in a message, in characters.
_MAX_VALUE = 60
# Largest length, in characters, of a list of known names, given where none of them is similar.
_MAX_NAMES = 240
# Limits of at least this size are written with thousands separators.
_LARGE = 10_000
_LIMITS = {
    "greater_than": ("gt", "is not above"),
    "greater_than_equal": ("ge", "is below"),
    "less_than": ("lt", "is not below"),
    "less_than_equal": ("le", "is above"),
}
_KINDS = {
    "float_type": "is not a number",
    "int_type": "is not a whole number",
    "int_from_float": "is not a whole number",
    "string_type": "is not text",
    "bool_type": "is neither true nor false",
    "tuple_type": "is not a list",
    "list_type": "is not a list",
    "finite_number": "is not finite",
    "model_type": "is not a table",
    "model_attributes_type": "is not a table",
    "dict_type": "is not a table",
    "string_pattern_mismatch": "does not have the required form",
    "literal_error": "is not one of the possible values",
}


def near_miss(name: str, known: Iterable[str]) -> str:
    """Suggest the known name that was probably meant, or list the known names."""
    names = sorted(known)
    close = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.55)
    if close:
        return f"did you mean {close[0]!r}?"
    ends = itertools.accumulate(len(name) + 2 for name in names)
    listed = [name for name, end in zip(names, ends, strict=True) if end <= _MAX_NAMES] or names[:1]
    more = f" and {len(names) - len(listed)} more" if len(names) > len(listed) else ""
    return f"choose from {', '.join(listed)}{more}" if names else "there are none"


def shown(value: object) -> str:
    """Spell a value as in TOML, shortened where it is long."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _MAX_VALUE else text[: _MAX_VALUE - 1] + "…"


def validated(
    model: type[ModelT], data: object, located: Callable[[Fault], str] = str, **context: object
) -> ModelT:
    """Return a table as a model; RequestError with a line for each fault, which `located` makes."""
    try:
        return model.model_validate(data, context=context)
    except ValidationError as error:
        raise RequestError([*map(located, model_faults(error, model, data))]) from None


def model_faults(error: ValidationError, model: type[BaseModel], data: object) -> list[Fault]:
    """Return one line per fault, in the order found; of the faults of a union, only the first."""
    lines: dict[str, Fault] = {}
    errors = error.errors(include_url=False)
    for details in errors:
        # pydantic counts only valid items: a list that has invalid ones need not be too short.
        depth = len(details["loc"])
        if details["type"] == "too_short" and any(
            len(other["loc"]) > depth and other["loc"][:depth] == details["loc"] for other in errors
        ):
            continue
        path = _path_in(data, details)
        for line in _lines(details, model, path):
            # A value that fits no member of a union has an error for each: keep the first.
            key = line if details["type"] == "value_error" else _spelled(path)
            lines.setdefault(key, line)
    return list(lines.values())


def _lines(
    details: "ErrorDetails", model: type[BaseModel], path: Sequence[str | int]
) -> list[Fault]:
    """Return the lines for one of pydantic's errors."""
    key, kind, given = _spelled(path), details["type"], details["input"]
    context = details.get("ctx", {})
    description = _description(model, path)
    remedy = f"; {remedy_of(description)}" if description else ""
    if kind == "extra_forbidden":
        owner = _model(model, path[:-1])
        fields = owner.model_fields if owner is not None else {}
        known = (field.alias or name for name, field in fields.items())
        return [Fault(key, f": {near_miss(str(path[-1]), known)}", "unknown key ")]
    if kind == "missing":
        return [Fault(key, f" is missing{remedy}")]
    if kind == "value_error":
        remedy = "" if isinstance(context["error"], RemediedError) else remedy
        return [Fault(key, f"{' ' * bool(key)}{why}{remedy}") for why in context["error"].args]
    if kind in _LIMITS:
        bound, relation = _LIMITS[kind]
        fault = f"{relation} {limit_text(context[bound])}"
    elif kind in {"too_short", "too_long"}:
        limit = context.get("min_length", context.get("max_length"))
        fault = f"has {context['actual_length'] or len(given):,} items, not {limit:,}"
    else:
        fault = _KINDS.get(kind, details["msg"].lower())
    return [Fault(key, f" = {shown(given)} {fault}{remedy}")]


def limit_text(limit: float) -> str:
    """Spell a limit; a large one with all its digits and with thousands separators."""
    return f"{int(limit):,}" if abs(limit) >= _LARGE else f"{limit:g}"


def remedy_of(description: str) -> str:
    """Return the last sentence of a key's description, for the end of a message."""
    sentence = description.removesuffix(".").rpartition(". ")[2]
    return sentence[:1].lower() + sentence[1:]


def _path_in(data: object, details: "ErrorDetails") -> list[str | int]:
    """Return the path through the data: pydantic's location without names of union members."""
    path: list[str | int] = []
    here: Any = data
    for step in details["loc"]:
        in_list = isinstance(here, list) and isinstance(step, int) and step < len(here)
        if in_list or (isinstance(here, dict) and step in here):
            here = here[step]
        elif details["type"] != "missing" or step != details["loc"][-1]:
            continue
        path.append(step)
    return path


def _spelled(path: Sequence[str | int]) -> str:
    """Spell a path as `seasons[0].name`."""
    text = ""
    for step in path:
        if isinstance(step, int):
            text += f"[{step}]"
        else:
            text += f".{step}" if text else step
    return text


def _description(model: type[BaseModel], path: Sequence[str | int]) -> str:
    """Return the description of the last key on a path, or ""."""
    names = [step for step in path if isinstance(step, str)]
    owner = _model(model, names[:-1])
    if not names or owner is None:
        return ""
    return descriptions(owner).get(names[-1], "")


def _model(model: type[BaseModel], path: Sequence[str | int]) -> type[BaseModel] | None:
    """Return the model that a path leads to, or None."""
    here: type[BaseModel] | None = model
    for step in path:
        if isinstance(step, int):
            continue
        field = here.model_fields.get(step) if here is not None else None
        here = model_in(field.annotation) if field is not None else None
    return here


def model_in(annotation: object) -> type[BaseModel] | None:
    """Return the model inside an annotation such as `tuple[Season, ...]` or `Region | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    inner = (model_in(part) for part in get_args(annotation))
    return next((model for model in inner if model is not None), None)
