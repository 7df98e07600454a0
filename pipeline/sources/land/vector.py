"""Land out of a file of the user's: GeoPackage, GeoJSON, Shapefile, whatever GDAL reads.

Any CRS; invalid rings mended; points and lines (rocks, breakwaters, a coast that is no area) taken
as wide as the user says. What can't be told from the file is asked for, and not guessed: which
layer of several, the CRS where none is given.
"""

from __future__ import annotations

import glob
import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import shapely

from pipeline.model import Credit, Land
from pipeline.sources.land.polygons import box_around, mended_note, polygonal, widened
from pipeline.sources.land.vector_layer import fault, open_layer

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    from shapely.geometry import Polygon

    from pipeline.scenario.catalogue import VectorSpec
    from pipeline.scenario.region import ChartSource
    from pipeline.sources.land.vector_layer import VectorLayer

    Geometries = npt.NDArray[np.object_]

_POINT, _LINE, _AREA = 0, 1, 2
# Of a file that nobody speaks for: what a coast of 1:100,000 is drawn to.
_ASSUMED_ACCURACY_M = 50.0


@dataclass(frozen=True)
class VectorFile:
    """One layer of a vector file; `asked` says which, and what the file does not say itself.

    `entry` is that of the catalogue for such a file, where one was named.
    """

    path: Path
    asked: ChartSource
    entry: VectorSpec | None = None

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """What is asked of the file, and hash of it and of the files that belong to it."""
        digest = hashlib.sha256()
        for file in sorted(self.path.parent.glob(f"{glob.escape(self.path.stem)}.*")):
            # A file geodatabase is a folder.
            for part in sorted(file.rglob("*")) if file.is_dir() else [file]:
                if part.is_file():
                    digest.update(part.name.encode())
                    with part.open("rb") as content:
                        digest.update(hashlib.file_digest(content, "sha256").digest())
        entry = self.entry.model_dump_json() if self.entry else ""
        return ("vector", self.asked.model_dump_json(), entry, digest.hexdigest())

    @property
    def credit(self) -> Credit:
        """What the scenario says of the file, else what the catalogue does."""
        entry, asked = self.entry, self.asked
        return Credit(
            name=entry.title if entry else self.path.name,
            kind="land",
            text=asked.credit or (entry.credit if entry else f"{self.path.name}, the user's own"),
            licence=asked.licence or (entry.licence if entry else "the user's own to know"),
            url=entry.url if entry else "",
        )

    @property
    def accuracy_m(self) -> float:
        """How far the file's coast may be off, in metres."""
        if self.asked.accuracy_m is not None:
            return self.asked.accuracy_m
        return self.entry.accuracy_m if self.entry else _ASSUMED_ACCURACY_M

    def land(self, region: Polygon) -> Land:
        """Land near a region (lon/lat degrees)."""
        box = box_around(region)
        layer = open_layer(self.path, self.asked.layer, self.asked.crs)
        found, count = layer.near(box)
        if len(found) == 0:
            raise self._elsewhere(layer)
        return Land(
            polygons=tuple(self._areas(found).tolist()),
            credits=(self.credit,),
            accuracy_m=self.accuracy_m,
            notes=(*mended_note(self.path.name, count), *self._accuracy_note()),
        )

    def _areas(self, geometry: Geometries) -> Geometries:
        """Take areas as they are, points and lines as wide as asked for."""
        parts = shapely.get_parts(shapely.get_parts(geometry))
        dimension = shapely.get_dimensions(parts)
        thin = parts[dimension < _AREA]
        if len(thin) and self.asked.radius_m is None:
            what = [
                f"{count:,} {name}"
                for kind, name in ((_POINT, "points"), (_LINE, "lines"))
                if (count := int((dimension == kind).sum()))
            ]
            raise fault(
                self.path,
                f"has {' and '.join(what)} near the region, which are no areas: make polygons of "
                f'them, or say how wide they are: {{ path = "{self.path.name}", radius_m = 20 }}',
            )
        return polygonal(
            np.concatenate([parts[dimension == _AREA], widened(thin, self.asked.radius_m or 0.0)])
        )

    def _elsewhere(self, layer: VectorLayer) -> Exception:
        """Say where the file's land is, when none is near the region."""
        bounds = ", ".join(f"{bound:g}" for bound in layer.bounds())
        return fault(
            self.path,
            f"has nothing near the region (its bounds in {layer.crs.name}: {bounds}): leave it out "
            "or, if it should, name its right CRS",
        )

    def _accuracy_note(self) -> tuple[str, ...]:
        """Say where an accuracy is assumed."""
        if self.entry or self.asked.accuracy_m is not None:
            return ()
        note = (
            f"{self.path.name}: its coast is taken to be right to {_ASSUMED_ACCURACY_M:g} m, as "
            "its accuracy is not given (accuracy_m)"
        )
        return (note,)
