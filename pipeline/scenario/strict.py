"""Types of the catalogue's entries: strict tables, and numbers with limits.

The last sentence of a key's description is the remedy: an error message about the key ends in it.
"""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict, ValidationInfo

from pipeline.machine.paths import resolved, shown, unusable_reason

# Separates the faults of one validator in the text of its ValueError.
FAULT_SEPARATOR = "\n"


class StrictModel(BaseModel):
    """A frozen table that refuses unknown keys and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


# A name becomes the name of folders and files: only characters that every file system and shell
# accepts.
Name = Annotated[
    str,
    Field(
        pattern=r"^[a-z0-9]([a-z0-9_-]{0,62}[a-z0-9])?$",
        description="Name in the catalogue, and of the files made from it. Use up to 64 "
        "lower-case letters, digits, '-' and '_'.",
    ),
]
Number = Annotated[float, Strict()]
Integer = Annotated[int, Strict()]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Longitude = Annotated[Number, Field(ge=-180, le=360)]
Latitude = Annotated[Number, Field(ge=-90, le=90)]
LonLat = tuple[Longitude, Latitude]
# A coordinate, degrees or metres: beyond any plane, where squares still don't overflow.
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
    """Whether a source is given by its path: catalogue names have none of these characters."""
    return bool(set(text) & set("/\\.~"))


def usable_path(text: str, info: ValidationInfo) -> str:
    """Refuse a text that can't be a path; make it absolute where the context names a `folder`."""
    if reason := unusable_reason(text):
        raise ValueError(f"= '{shown(text)}' {reason}")
    if not (text and info.context):
        return text
    is_relative = not text.startswith(("~", "/"))
    return str(resolved(info.context["folder"] / text if is_relative else text, "scenario"))


PathText = Annotated[str, AfterValidator(usable_path)]
SimpleRing = AfterValidator(_simple_polygon)
Corners = Annotated[tuple[Point, ...], Field(min_length=3), SimpleRing]
