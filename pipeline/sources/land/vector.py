"""Land from the user's own vector file: GeoPackage, GeoJSON, Shapefile, anything that GDAL reads.

In any CRS; invalid rings are repaired, and points and lines (rocks, breakwaters, a coast that is no
area) are buffered by a radius that the user gives. Facts that the file does not state (which of
several layers, the CRS, that radius) are asked for, not guessed.
"""

import glob
import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

from pipeline._types import Geometries
from pipeline.errors import RequestError
from pipeline.machine.paths import require_readable
from pipeline.model import Credit, Land, Note
from pipeline.scenario.catalogue import VectorSpec
from pipeline.scenario.region import ChartSource
from pipeline.sources.land import shapes
from pipeline.sources.land.vector_layer import VectorLayer, chart_fault, open_layer, reading_chart

# Dimensions of geometries.
_POINT, _LINE, _AREA = 0, 1, 2
# Accuracy of the coast where it is not given, m: that of a chart of 1:100,000.
_ASSUMED_ACCURACY_M = 50.0


@dataclass(frozen=True)
class VectorFile:
    """One layer of a vector file; `source` is the scenario's table about it.

    `entry` is the catalogue's entry for such files, where the scenario names one.
    """

    path: Path
    source: ChartSource
    entry: VectorSpec | None = None

    @cached_property
    def identity(self) -> tuple[str, ...]:
        """The scenario's table about the file, and a hash of it and its sidecar files."""
        digest = hashlib.sha256()
        files = self._files
        with reading_chart(self.path):
            for file in files:
                # A file geodatabase is a folder.
                for part in sorted(file.rglob("*")) if file.is_dir() else [file]:
                    if part.is_file():
                        digest.update(part.name.encode())
                        with part.open("rb") as content:
                            digest.update(hashlib.file_digest(content, "sha256").digest())
        entry = self.entry.model_dump_json() if self.entry else ""
        return ("vector", self.source.model_dump_json(), entry, digest.hexdigest())

    @cached_property
    def _files(self) -> tuple[Path, ...]:
        """The file and its sidecar files, such as .dbf and .prj, which GDAL reads too."""
        pattern = f"{glob.escape(self.path.stem)}.*"
        files = tuple(sorted({self.path, *self.path.parent.glob(pattern)}))
        require_readable(files, "chart.source")
        return files

    @property
    def credit(self) -> Credit:
        """The credit that the scenario gives, else the catalogue's."""
        entry, source = self.entry, self.source
        return Credit(
            name=entry.title if entry else self.path.name,
            kind="land",
            text=source.credit or (entry.credit if entry else f"{self.path.name}, user's file"),
            licence=source.licence or (entry.licence if entry else "not given"),
            url=entry.url if entry else "",
        )

    @property
    def accuracy_m(self) -> float:
        """How far the file's coast may be off, m."""
        if self.source.accuracy_m is not None:
            return self.source.accuracy_m
        return self.entry.accuracy_m if self.entry else _ASSUMED_ACCURACY_M

    def land(self, region: shapely.Polygon) -> Land:
        """Return the land near a region (lon/lat degrees)."""
        box = shapes.box_around(region)
        require_readable(self._files, "chart.source")
        layer = open_layer(self.path, self.source.layer, self.source.crs)
        found = layer.near(box)
        if len(found.geometry) == 0:
            raise self._nothing_near(layer)
        repairs = shapes.repair_note(self.path.name, found.repaired)
        return Land(
            polygons=tuple(self._areas(found.geometry).tolist()),
            credits=(self.credit,),
            accuracy_m=self.accuracy_m,
            notes=(*repairs, *found.notes, *self._accuracy_note()),
            places=layer.places(box),
        )

    def _areas(self, geometry: Geometries) -> Geometries:
        """Return areas as they are, and points and lines buffered by the radius given."""
        # Clipping to the region makes collections again.
        parts = shapes.flattened(geometry)
        dimension = shapely.get_dimensions(parts)
        thin = parts[dimension < _AREA]
        if len(thin) and self.source.radius_m is None:
            counts = [
                f"{count:,} {name}"
                for kind, name in ((_POINT, "points"), (_LINE, "lines"))
                if (count := int((dimension == kind).sum()))
            ]
            raise chart_fault(
                self.path,
                f"has {' and '.join(counts)} near the region, which are not areas: make polygons "
                "of them, or give the radius in metres that is no-go around them: "
                f'{{ path = "{self.path.name}", radius_m = 20 }}',
            )
        grown = shapes.buffered(thin, self.source.radius_m or 0.0)
        return shapes.extract_polygons(np.concatenate([parts[dimension == _AREA], grown]))

    def _nothing_near(self, layer: VectorLayer) -> RequestError:
        """Say where the file's land is, when none is near the region."""
        bounds = layer.bounds()
        if bounds is None:
            return chart_fault(
                self.path, "has no feature with a geometry; give a file that has the land"
            )
        listed = ", ".join(f"{bound:g}" for bound in bounds)
        return chart_fault(
            self.path,
            f"has nothing near the region (its bounds in {layer.crs.name}: {listed}): leave it "
            "out, or name the right CRS if that is wrong",
        )

    def _accuracy_note(self) -> tuple[Note, ...]:
        """Say that an accuracy is assumed, if so."""
        if self.entry or self.source.accuracy_m is not None:
            return ()
        name, accuracy_m = self.path.name, _ASSUMED_ACCURACY_M
        return (Note.of("accuracy-assumed", source=name, accuracy_m=accuracy_m),)
