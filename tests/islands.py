"""Adds islands that people know to the catalogue: `python -m tests.islands`.

`known_islands.csv` has names, places and areas written down by hand, from common knowledge. The
outline is that of OpenStreetMap's land: the polygon at the place, or near it, of about that area.
So a slip in a place or an area finds nothing, and is refused by name. Rows of the catalogue that
stand for the same polygon are replaced; all others stay.
"""

import csv
import math

import numpy as np
import shapely
from roaring_landmask import LandmaskProvider, Shapes

from pipeline.scenario import catalogue
from tests.conftest import ROOT

KNOWN = ROOT / "tests" / "known_islands.csv"
COLUMNS = ("name", "lon", "lat", "west", "south", "east", "north", "area_km2")
# Distance between the place and the outline, degrees, and error of the area, as a share.
_NEAR_DEG, _OFF = 0.1, 0.16
_KM_PER_DEGREE = 111.195


def area_km2(outline: shapely.Geometry) -> float:
    """Return the area of an outline in degrees: on the cylinder of equal areas."""

    def flat(lonlat: np.ndarray) -> np.ndarray:
        return np.column_stack((lonlat[:, 0], np.degrees(np.sin(np.radians(lonlat[:, 1])))))

    return float(shapely.transform(outline, flat).area) * _KM_PER_DEGREE**2


def world() -> np.ndarray:
    """Return the world's land: OpenStreetMap's polygons, degrees."""
    return np.asarray(shapely.get_parts(shapely.from_wkb(Shapes.wkb(LandmaskProvider.Osm))))


def outline(
    land: shapely.STRtree, name: str, lon: float, lat: float, area: float
) -> shapely.Geometry:
    """Return the polygon of a known island; ValueError if none, or none so large, is near."""
    place = shapely.Point(lon, lat)
    near = land.geometries[land.query(place, "dwithin", _NEAR_DEG)]
    alike = [one for one in near if abs(math.log(area_km2(one) / area)) < _OFF]
    if not alike:
        areas = ", ".join(f"{one:.1f}" for one in sorted(map(area_km2, near), reverse=True)[:4])
        raise ValueError(f"{name}: no land of {area:g} km2 at {lon} {lat}, but of {areas} km2")
    return min(alike, key=place.distance)


def rows(land: shapely.STRtree) -> list[dict[str, str]]:
    """Return the catalogue's rows with the known islands, the largest first."""
    with KNOWN.open(encoding="utf-8", newline="") as file:
        known = list(csv.DictReader(file))
    with (catalogue.root() / "islands.csv").open(encoding="utf-8", newline="") as file:
        kept = list(csv.DictReader(file))
    faults = []
    for one in known:
        lon, lat, area = (float(one[key]) for key in ("lon", "lat", "area_km2"))
        try:
            found = outline(land, one["name"], lon, lat, area)
        except ValueError as error:
            faults.append(str(error))
            continue
        kept = [
            row
            for row in kept
            if not shapely.contains_xy(found, float(row["lon"]), float(row["lat"]))
        ]
        point = shapely.point_on_surface(found)
        sides = (f"{side:.3f}" for side in found.bounds)
        place = f"{point.x:.4f}", f"{point.y:.4f}"
        kept.append(
            dict(zip(COLUMNS, (one["name"], *place, *sides, f"{area_km2(found):.1f}"), strict=True))
        )
    if faults:
        raise SystemExit("\n".join(faults))
    return sorted(kept, key=lambda row: -float(row["area_km2"]))


def main() -> None:
    """Write the catalogue's islands."""
    table = rows(shapely.STRtree(world()))
    with (catalogue.root() / "islands.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)


if __name__ == "__main__":
    main()
