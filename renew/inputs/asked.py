"""What is asked of a plan: where, with which vessel, in which current, and how."""

from dataclasses import dataclass

from renew._types import FloatArray
from renew.inputs.chart import Chart
from renew.inputs.current import CurrentField
from renew.inputs.options import Request
from renew.inputs.shut_areas import Area
from renew.inputs.tidal_depth import TidalDepth
from renew.inputs.vessel import Vessel


@dataclass(frozen=True, eq=False)
class Asked:
    """Where to plan, with which vessel, in which current, and how.

    The `chart` excludes the water of areas that are always shut; `areas` are shut for some hours,
    among them those of the `depth`. Start, via points and goal are `stops` (n, 2), m. If the
    current is the mean of an ensemble, `members` are the fields in which turns are to be clear.
    """

    chart: Chart
    current: CurrentField
    vessel: Vessel
    stops: FloatArray
    areas: tuple[Area, ...]
    request: Request
    depth: TidalDepth | None = None
    members: tuple[CurrentField, ...] = ()
