"""The area of a scenario: its region or plane, the chart of its land, and areas to avoid."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Field, model_serializer, model_validator

from pipeline.scenario import strict
from pipeline.scenario.strict import NonNegative, StrictModel

if TYPE_CHECKING:
    from pydantic import SerializerFunctionWrapHandler
    from shapely.geometry import Polygon


def _refuse_empty(key: str, limits: tuple[float, float, float, float], remedy: str) -> None:
    """Refuse limits [left, bottom, right, top] that hold nothing between them."""
    left, bottom, right, top = limits
    if not (left < right and bottom < top):
        raise strict.RemediedError(f"has {key} {list(limits)}, which is empty: {remedy}")


class Region(StrictModel):
    """The region of a chart scenario in lon/lat degrees: either a box or a polygon.

    Across 180 degrees, longitudes continue (170 to 190).
    """

    bbox: strict.LonLatBox | None = None
    polygon: strict.LonLatRing | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.bbox is None) == (self.polygon is None):
            raise strict.RemediedError("must have either 'bbox' or 'polygon'; give one of the two")
        if self.bbox is not None:
            remedy = (
                "west must be below east and south below north; across 180 degrees continue "
                "longitudes (170 to 190)"
            )
            _refuse_empty("bbox", self.bbox, remedy)
        return self

    @property
    def shape(self) -> "Polygon":
        """The region as a polygon, lon/lat degrees."""
        import shapely

        return shapely.box(*self.bbox) if self.bbox is not None else shapely.Polygon(self.polygon)


# Largest width and height of a plane, m: beyond it the earth is not flat.
MAX_PLANE_M = 2e6
# Least ratio of a plane's sides: the planner's grid of coordinates is a billionth of its diagonal.
_MIN_RATIO = 1e-6


class Plane(StrictModel):
    """The area of a plane scenario in metres, in place of region and chart."""

    extent: tuple[strict.Number, strict.Number, strict.Number, strict.Number]
    obstacles: tuple[strict.Corners, ...] = ()
    credit: str = "Figures of the scenario"

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        xmin, ymin, xmax, ymax = self.extent
        _refuse_empty("extent", self.extent, "give [xmin, ymin, xmax, ymax]")
        if self.width_m > MAX_PLANE_M:
            raise strict.RemediedError(
                f"has extent {list(self.extent)}, {self.width_m / 1000:,.0f} km wide; a plane is "
                f"at most {MAX_PLANE_M / 1000:,.0f} km wide: shrink it, or add a [region]"
            )
        height_m = min(xmax - xmin, ymax - ymin)
        if height_m < _MIN_RATIO * self.width_m:
            raise strict.RemediedError(
                f"has extent {list(self.extent)}, {height_m:.3g} m across; give it at least a "
                "millionth of its longer side"
            )
        return self

    @property
    def width_m(self) -> float:
        """The longer side of the extent, m."""
        xmin, ymin, xmax, ymax = self.extent
        return max(xmax - xmin, ymax - ymin)

    @property
    def shape(self) -> "Polygon":
        """The extent as a polygon, metres."""
        import shapely

        return shapely.box(*self.extent)


class _VectorKeys(StrictModel):
    """How a vector file is read."""

    layer: str = ""
    crs: str = ""
    radius_m: strict.Positive | None = None


class ChartSource(_VectorKeys):
    """A source of land: an entry of the catalogue, a file or folder of the user's, or both.

    An entry states the licence and accuracy of the data in the path; keys given here override it.
    """

    name: str = ""
    path: strict.PathText = ""
    accuracy_m: NonNegative | None = None
    complete: bool = False
    credit: str = ""
    licence: str = ""

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if not (self.name or self.path):
            raise strict.RemediedError(
                "has neither 'name' nor 'path'; give one of the two, or both"
            )
        return self

    @property
    def is_s57(self) -> bool:
        """Whether its path is an S-57 cell, an update of one, or a folder of them."""
        path = Path(self.path)
        is_cell_file = len(path.suffix) == 4 and path.suffix[1:].isdecimal()
        return bool(self.path) and (is_cell_file or (path.is_dir() and path.suffix != ".gdb"))


def _as_sources(given: object) -> object:
    """Turn one source into a list of one, and a text into a source by its name or path."""
    return [
        {"path" if strict.looks_like_path(one) else "name": one} if isinstance(one, str) else one
        for one in (given if isinstance(given, (list, tuple)) else (given,))
    ]


class ChartSpec(StrictModel):
    """The land of a chart scenario, and how the hard no-go zone is made from it."""

    source: Annotated[
        tuple[ChartSource, ...],
        Field(min_length=1),
        BeforeValidator(
            _as_sources, json_schema_input_type=str | ChartSource | list[str | ChartSource]
        ),
    ] = (ChartSource(name="osm-land"),)
    depths: strict.PathText = ""
    depths_positive: Literal["", "up", "down"] = ""
    under_keel_clearance_m: NonNegative = 1.0
    datum: str = ""
    margin_m: NonNegative | None = None
    tolerance_m: NonNegative | None = None

    @property
    def no_go(self) -> str:
        """What a place that is not in water may lie on: on a chart with depths also in shallows."""
        has_depths = self.depths or any(source.is_s57 for source in self.source)
        return "land, or water too shallow for the vessel or not charted" if has_depths else "land"


class AvoidedArea(_VectorKeys):
    """Polygons of a file that no route may enter between two times, or at any time."""

    model_config = ConfigDict(populate_by_name=True)

    path: strict.PathText
    begin: strict.Moment | None = Field(default=None, alias="from")
    until: strict.Moment | None = None

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if self.begin is not None and self.until is not None and self.until <= self.begin:
            raise strict.RemediedError(
                f"is shut from {self.begin.isoformat()} until {self.until.isoformat()}, which is "
                "not later; give a later time"
            )
        return self

    @model_serializer(mode="wrap")
    def _by_its_keys(self, dump: "SerializerFunctionWrapHandler") -> dict[str, Any]:
        """Spell the keys as a scenario does: `from` is no name in Python."""
        return {("from" if key == "begin" else key): value for key, value in dump(self).items()}

    @property
    def has_hours(self) -> bool:
        """Whether it is open at some time."""
        return self.begin is not None or self.until is not None
