"""The area of a scenario: its region or plane, the chart of its land, and areas to avoid."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AwareDatetime,
    BeforeValidator,
    ConfigDict,
    Field,
    model_serializer,
    model_validator,
)

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

    bbox: strict.LonLatBox | None = Field(
        default=None, examples=[[115.5, 7.0, 122.0, 13.5]], json_schema_extra=strict.unit("degrees")
    )
    """Limits of the region, degrees. Give [west, south, east, north], or a polygon."""
    polygon: strict.LonLatRing | None = Field(
        default=None,
        examples=[[[115.5, 7.0], [122.0, 7.0], [122.0, 13.5]]],
        json_schema_extra=strict.unit("degrees"),
    )
    """Corners [lon, lat] of the region, degrees, in place of bbox. List them in their order round
    the edge."""
    crs: str | None = Field(default=None, examples=["EPSG:32651"])
    """Conformal projected CRS to plan in, as pyproj knows it. Leave it out to have one chosen that
    fits the region."""

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

        if self.bbox is not None:
            return shapely.box(*self.bbox)
        return shapely.Polygon(self.polygon)


# Largest width and height of a plane, m: beyond it the earth is not flat.
MAX_PLANE_M = 2e6
# Least ratio of a plane's sides: the planner's grid of coordinates is a billionth of its diagonal.
_MIN_RATIO = 1e-6


class Plane(StrictModel):
    """The area of a plane scenario in metres, in place of region and chart."""

    extent: tuple[strict.Number, strict.Number, strict.Number, strict.Number] = Field(
        examples=[[0, 0, 100, 100]], json_schema_extra=strict.unit("m")
    )
    """Limits of the plane, metres. Give [xmin, ymin, xmax, ymax]."""
    obstacles: tuple[strict.Corners, ...] = Field(
        default=(),
        examples=[[[[40, 30], [60, 30], [60, 70], [40, 70]]]],
        json_schema_extra=strict.unit("m"),
    )
    """No-go polygons, each a list of its corners [x, y], metres. List the corners in their order
    round the edge."""
    credit: str = "Figures of the scenario"
    """Credit line for the obstacles, printed with the results. Give any text."""

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

    layer: str = Field(default="", examples=["piers"])
    """Layer of the vector file, needed if it has several. Give the name of a layer of the file."""
    crs: str = Field(default="", examples=["EPSG:4326"])
    """CRS of the vector file, in place of the one that it states itself; needed if it states none.
    Give what pyproj knows, such as 'EPSG:4326'."""
    radius_m: strict.Positive | None = Field(default=None, examples=[50])
    """Radius of the no-go zone around each point and line of the file, metres; needed if it has
    any. Give metres above 0."""


class ChartSource(_VectorKeys):
    """A source of land: an entry of the catalogue, a file or folder of the user's, or both.

    An entry states the licence and accuracy of the data in the path; keys given here override it.
    """

    name: str = Field(default="", examples=["osm-land"])
    """Source of land in the catalogue. Give a name that `renew list` shows under sources, or a
    path."""
    path: strict.PathText = Field(default="", examples=["./piers.gpkg"])
    """File or folder with the data; relative paths start at the scenario's folder. Give a vector
    file, or a folder of S-57 cells."""
    accuracy_m: NonNegative | None = Field(default=None, examples=[5])
    """How far the file's coast may lie from the true one, metres; by default the accuracy of the
    catalogue entry, or 50 m without one. Give metres, 0 or more."""
    complete: bool = False
    """Whether the file has all land near the region: then a route over land that only OpenStreetMap
    has is reported, and not refused. Give true where the file is right, or false."""
    credit: str = Field(default="", examples=["© Harbour office"])
    """Credit line for the data, printed with the results. Give the text that the data's licence
    requires."""
    licence: str = Field(default="", examples=["CC BY 4.0"])
    """Licence of the data. Give its name."""

    @model_validator(mode="after")
    def _is_somewhere(self) -> Self:
        if not (self.name or self.path):
            raise strict.RemediedError(
                "has neither 'name' nor 'path'; give one of the two, or both"
            )
        return self


def _as_sources(given: object) -> object:
    """Turn one source into a list of one, and a text into a source by its name or path."""
    return [
        {"path" if strict.looks_like_path(source) else "name": source}
        if isinstance(source, str)
        else source
        for source in (given if isinstance(given, (list, tuple)) else (given,))
    ]


class ChartSpec(StrictModel):
    """The land of a chart scenario, and how the hard no-go zone is made from it."""

    source: Annotated[
        tuple[ChartSource, ...],
        Field(min_length=1),
        BeforeValidator(
            _as_sources, json_schema_input_type=str | ChartSource | list[str | ChartSource]
        ),
    ] = Field(
        default=(ChartSource(name="osm-land"),),
        examples=["osm-land", ["osm-land", {"path": "./piers.gpkg", "accuracy_m": 5}]],
    )
    """Sources of land: what one of them marks as no-go is no-go. Give a source's name (`renew
    list`), a path, a table, or a list of them."""
    depths: strict.PathText = Field(default="", examples=["gebco.nc"])
    """Grid of depths, NetCDF as of GEBCO or EMODnet, S-102, BAG or GeoTIFF: what it shows shallower
    than the vessel's draught plus the under-keel clearance is no-go, with one cell around; relative
    paths start at the scenario's folder. Give a file, or leave it out."""
    depths_positive: Literal["", "up", "down"] = Field(default="", examples=["up"])
    """Whether the grid of depths has heights in metres, which count up, or depths, which count
    down, where the file does not say it. Give 'up' or 'down', or leave it out."""
    under_keel_clearance_m: NonNegative = 1.0
    """Under-keel clearance, metres: on charts with depths, water shallower than the vessel's
    draught plus this is no-go; allow for waves, and without a [tide] for low water. Give metres, 0
    or more."""
    datum: str = Field(default="", examples=["MLLW"])
    """Chart datum from which the depths are counted; by default the one that the chart states. Give
    the name that the tide's station uses, as MLLW or LAT."""
    margin_m: NonNegative | None = Field(default=None, examples=[60])
    """Margin added to every coast, metres; by default the chart's accuracy, and never less than
    that. Give metres, 0 or more."""
    tolerance_m: NonNegative | None = Field(default=None, examples=[100])
    """How far the simplified coast may lie off the land and its margin, metres, always on the
    water's side; by default chosen by the chart's accuracy, the vessel's turning radius and the
    size of the region. Give metres, 0 or more."""


class AvoidedArea(_VectorKeys):
    """Polygons of a file that no route may enter between two times, or at any time."""

    model_config = ConfigDict(populate_by_name=True)

    path: strict.PathText = Field(examples=["./firing-range.geojson"])
    """File with the polygons, in lon/lat or the CRS that it states; relative paths start at the
    scenario's folder. Give a GeoJSON file, or another vector file."""
    begin: AwareDatetime | None = Field(
        default=None, alias="from", examples=["2026-07-01T09:00:00Z"]
    )
    """Time from which the area is shut; if left out, it has been shut for ever. Give a time with
    its zone, as 2026-07-01T09:00:00Z, or leave it out."""
    until: AwareDatetime | None = Field(default=None, examples=["2026-07-01T12:40:00Z"])
    """Time until which the area is shut; if left out, it stays shut. Give a time with its zone, as
    2026-07-01T12:40:00Z, or leave it out."""

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
