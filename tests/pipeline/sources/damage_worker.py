"""Reads charts and currents in a process of its own, whose end by a library harms no test.

Each line of its input is a kind and a path; it answers with one line of JSON.
"""

from __future__ import annotations

import json
import re
import resource
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

import shapely

from pipeline.errors import PipelineError
from pipeline.model import Land
from pipeline.scenario.region import ChartSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.current_field import LandMask
from pipeline.sources.registry import land_source
from tests.pipeline.kept_land_mask import keep_land_mask

# Regions that the undamaged charts and currents cover.
VECTOR_REGION = shapely.box(118.0, 9.0, 120.0, 11.0)
S57_REGION = shapely.box(-70.99, 42.31, -70.96, 42.34)
CURRENT_REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
# Memory that the process may map, bytes: so that one that runs away does not harm the machine.
_MAX_MAPPED = 12 << 30


def read_chart(path: Path) -> str:
    """Read a chart as a run does: its identity, then its land."""
    region = S57_REGION if path.is_dir() else VECTOR_REGION
    chart = ChartSpec.model_validate({"source": {"path": str(path), "radius_m": 20}})
    source = land_source(chart, 1.0)
    land = source.land(region) if source.identity else None
    assert land is not None
    assert shapely.is_valid(list(land.polygons)).all()
    return f"{len(land.polygons)} polygons"


def read_current(path: Path) -> str:
    """Read currents as a run does: what covers the region, then the field."""
    files = (str(path),)
    season = Season(name="summer", valid="2024-07-01", currents=(files,))
    source = CfFiles(files)
    assert source.identity(season)
    if reason := source.uncovered_reason(CURRENT_REGION, season):
        return f"refused: {reason}"
    grid = source.current(CURRENT_REGION, season, Land((), (), 0.0), path.parent)
    return f"{grid.u.shape} nodes"


READERS: dict[str, Callable[[Path], str]] = {"chart": read_chart, "current": read_current}


def outcome(kind: str, path: Path) -> dict[str, object]:
    """Read a file and say how that ended, in what CPU time (s) and memory (MB)."""
    began = time.process_time()
    try:
        said = READERS[kind](path)
        how = "refused" if said.startswith("refused: ") else "read"
    except PipelineError as error:
        how, said = "refused", str(error)
    except Exception:  # noqa: BLE001 - which is what the test is about
        how, said = "traceback", traceback.format_exc()
    return {
        "how": how,
        "said": said,
        "cpu_s": time.process_time() - began,
        "peak_mb": _peak_mb(),
    }


def _peak_mb() -> int:
    """Peak memory of this process (MB): not ru_maxrss, which begins with that of its parent."""
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text("utf-8")) if status.exists() else None
    return int(found[1]) >> 10 if found else 0


def main() -> None:
    """Answer line by line."""
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MAPPED, _MAX_MAPPED))
    # The mask takes seconds to load, for each file anew.
    keep_land_mask()
    LandMask.world()
    for line in sys.stdin:
        kind, path = json.loads(line)
        print(json.dumps(outcome(kind, Path(path))), flush=True)  # noqa: T201 - this is how it answers


if __name__ == "__main__":
    main()
