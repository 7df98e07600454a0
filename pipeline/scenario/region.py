"""Where a scenario lies: its waters, and the chart that says what of them is land."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Self

from pydantic import BeforeValidator, Field, model_validator

from pipeline.scenario.strict import (
    Corners,
    Latitude,
    Longitude,
    LonLat,
    NotNegative,
    Number,
    Positive,
    Strictly,
    Whole,
    WholeRing,
    looks_like_path,
)

if TYPE_CHECKING:
    from shapely.geometry import Polygon


class Region(Strictly):
    """The waters of a chart scenario, lon/lat degrees: a box, or a polygon.

    Across 180 degrees longitudes go on (170 to 190).
    """

    bbox: tuple[Longitude, Latitude, Longitude, Latitude] | None = Field(
        default=None, description="give [west, south, east, north] in degrees"
    )
    polygon: Annotated[tuple[LonLat, ...], Field(min_length=3), WholeRing] | None = Field(
        default=None, description="list its corners in their order round the edge"
    )
    crs: str | None = Field(
        default=None, description="leave it out to have a conformal plane chosen"
    )

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.bbox is None) == (self.polygon is None):
            raise ValueError("must have either 'bbox' or 'polygon'; give one of the two")
        if self.bbox is not None:
            west, south, east, north = self.bbox
            if not (west < east and south < north):
                raise ValueError(
                    f"has bbox {list(self.bbox)}, which is empty: west must be below east and "
                    "south below north; across 180 degrees go on counting (170 to 190)"
                )
        return self

    @property
    def shape(self) -> Polygon:
        """The region as a polygon, lon/lat degrees."""
        import shapely

        if self.bbox is not None:
            return shapely.box(*self.bbox)
        return shapely.Polygon(self.polygon)


class Plane(Strictly):
    """The waters of a plane scenario, in metres, and where its figures come from."""

    extent: tuple[Number, Number, Number, Number] = Field(
        description="give [xmin, ymin, xmax, ymax] in metres"
    )
    obstacles: tuple[Corners, ...] = Field(
        default=(), description="list each obstacle's corners in their order round the edge"
    )
    credit: str = "Figures of the scenario"

    @model_validator(mode="after")
    def _not_empty(self) -> Self:
        xmin, ymin, xmax, ymax = self.extent
        if not (xmin < xmax and ymin < ymax):
            raise ValueError(
                f"has extent {list(self.extent)}, which is empty: give [xmin, ymin, xmax, ymax]"
            )
        return self

    @property
    def shape(self) -> Polygon:
        """The extent as a polygon, metres."""
        import shapely

        return shapely.box(*self.extent)


class ChartSource(Strictly):
    """One source of a chart: an entry of the catalogue, a file or folder of the user's, or both.

    An entry says whose data a path holds and how accurate they are; what is given here goes before.
    """

    name: str = Field(default="", description="`renew list` names the sources")
    path: str = Field(default="", description="give a vector file, or a folder of S-57 cells")
    layer: str = Field(default="", description="give the name of a layer of the file")
    crs: str = Field(default="", description="give what pyproj knows, such as 'EPSG:4326'")
    radius_m: Positive | None = Field(
        default=None, description="give the metres around each point and line that are no-go"
    )
    accuracy_m: NotNegative | None = Field(
        default=None, description="give how far in metres the file's coast may be off"
    )
    credit: str = ""
    licence: str = ""

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if not (self.name or self.path):
            raise ValueError("has neither 'name' nor 'path'; give one of the two, or both")
        return self


def _as_sources(given: object) -> object:
    """Take one source for a list of one, and a text for a name, or for the path it looks like."""
    return [
        {"path" if looks_like_path(one) else "name": one} if isinstance(one, str) else one
        for one in (given if isinstance(given, (list, tuple)) else (given,))
    ]


class ChartSpec(Strictly):
    """Which land, and how it becomes the planner's no-go zone (true metres).

    Several sources are laid on top of each other: what one of them forbids is no-go.
    """

    source: Annotated[
        tuple[ChartSource, ...], Field(min_length=1), BeforeValidator(_as_sources)
    ] = Field(
        default=(ChartSource(name="osm-land"),),
        description="give a source's name (`renew list`), a path, or a list of them",
    )
    under_keel_clearance_m: NotNegative = Field(
        default=1.0, description="give the metres of water to be left below the keel"
    )
    margin_m: NotNegative | None = Field(
        default=None,
        description="give the metres added to every coast, or leave it out: the chart's accuracy",
    )
    join_gap_m: NotNegative = Field(
        default=0.0, description="give the widest gap in metres that is closed, or 0"
    )
    tolerance_m: NotNegative = Field(
        default=100.0, description="give the metres that the coast may be simplified by, or 0"
    )
    vertex_budget: Whole = Field(
        default=250, ge=8, description="give the number of vertices aimed at, some hundred"
    )
