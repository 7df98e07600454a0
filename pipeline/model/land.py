"""Land as it comes from its sources, and who is to be credited."""

from dataclasses import dataclass
from typing import Literal

from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from pipeline.geo.known_cells import DepthCover
from pipeline.model.notes import Note


@dataclass(frozen=True, slots=True)
class Credit:
    """A source that was used, and the credit line that its licence requires."""

    name: str
    kind: Literal["land", "current"]
    text: str
    licence: str
    url: str = ""
    retrieved: str = ""


@dataclass(frozen=True, slots=True)
class Zone:
    """An area of a chart to be shown on maps (lon/lat degrees).

    A `shoal` is too shallow for the vessel, a `hazard` lies in water that is not, an `uncharted`
    area is covered by no source: all are no-go, and so also among the polygons of their Land. A
    `restricted` area and a `traffic` scheme may be entered; `rule` is what the chart prescribes
    there for a passing vessel, if anything. Areas of the user's are `shut` at the hours that the
    rule names.
    """

    kind: Literal["shoal", "hazard", "uncharted", "restricted", "traffic", "shut"]
    name: str
    rule: str
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class DepthArea:
    """Water of a chart between two depths in metres at chart datum, NaN where not charted.

    A negative depth dries. `area` is in lon/lat degrees.
    """

    kind: Literal["natural", "dredged"]
    least_m: float
    greatest_m: float
    area: BaseGeometry


@dataclass(frozen=True, slots=True)
class PlaceName:
    """A chart's name for some land: a point on it (degrees), and how large it is (square degrees).

    Areas are compared with each other only.
    """

    name: str
    lon: float
    lat: float
    area_deg2: float


@dataclass(frozen=True, slots=True)
class Land:
    """All that no route may enter (lon/lat degrees), in the region and a little beyond.

    Land; from charts with depths, also shallow water, hazards and uncharted areas. `accuracy_m` is
    how far the source's coast may lie from the true one, in metres. `credits` has one entry per
    source, `notes` is what a reader should know about the chart, `zones` are areas to be shown.
    `second_shore` is the land of an independent shoreline, where there is one: no route need avoid
    it, but a route that crosses it does so where the two disagree. `places` are the chart's names
    of land, where it has any. `depths` says where the chart has depths; None where it has none at
    all. `depth_areas` are its areas of equal depth, where it has any.
    """

    polygons: tuple[Polygon, ...]
    credits: tuple[Credit, ...]
    accuracy_m: float
    notes: tuple[Note, ...] = ()
    zones: tuple[Zone, ...] = ()
    second_shore: tuple[Polygon, ...] = ()
    places: tuple[PlaceName, ...] = ()
    depths: DepthCover | None = None
    depth_areas: tuple[DepthArea, ...] = ()

    @property
    def no_go_name(self) -> str:
        """What no route may enter, for readers."""
        return no_go_name(has_depths=self.depths is not None)


def no_go_name(*, has_depths: bool) -> str:
    """What no route may enter, for readers: on a chart with depths it is more than land."""
    return "no-go areas" if has_depths else "land"
