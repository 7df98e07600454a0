"""What entries of the catalogue are made of: strict tables, and numbers that say their limits."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, Strict

# Several faults of one validator travel in one ValueError.
FAULT_SEPARATOR = "\n"


class Strictly(BaseModel):
    """Frozen; unknown keys are refused, and so are numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


# A name becomes a folder and a file's name: nothing that a file system or a shell could take amiss.
# Each description is the remedy that a fault's line ends in.
Name = Annotated[
    str,
    Field(
        pattern=r"^[a-z0-9]([a-z0-9_-]{0,62}[a-z0-9])?$",
        description="use up to 64 lower-case letters, digits, '-' and '_'",
    ),
]
Number = Annotated[float, Strict()]
Whole = Annotated[int, Strict()]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Longitude = Annotated[Number, Field(ge=-180, le=360)]
Latitude = Annotated[Number, Field(ge=-90, le=90)]
LonLat = tuple[Longitude, Latitude]
Point = tuple[Number, Number]


def _whole_polygon(corners: tuple[Point, ...]) -> tuple[Point, ...]:
    """Refuse a ring that crosses itself or has no area."""
    import shapely

    ring = shapely.Polygon(corners)
    if not ring.is_valid or ring.area == 0:
        reason = shapely.is_valid_reason(ring) if not ring.is_valid else "it has no area"
        raise ValueError(f"is no simple ring: {spoken_reason(reason)}")
    return corners


def spoken_reason(reason: str) -> str:
    """Say a reason of GEOS in words: "Self-intersection[1 9]" is "it crosses itself at 1, 9"."""
    kind, _, where = reason.partition("[")
    place = ", ".join(f"{float(number):g}" for number in where.rstrip("]").split())
    words = "it crosses itself" if "intersection" in kind.lower() else kind
    return f"{words} at {place}" if place else words


def looks_like_path(text: str) -> bool:
    """Whether a source is named by its path: names in the catalogue have none of these signs."""
    return bool(set(text) & set("/\\.~"))


WholeRing = AfterValidator(_whole_polygon)
Corners = Annotated[tuple[Point, ...], Field(min_length=3), WholeRing]
