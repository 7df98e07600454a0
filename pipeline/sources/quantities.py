"""Quantities that the reader of fields knows: currents of water, wind, gusts and waves.

A quantity is a row of `quantities.toml`: under which names files have it, in which units, and how
large it can be. Names are those of the CF conventions; of variables without a standard name, those
of the models' own files. GRIB's are in the WMO's Manual on Codes (FM 92), and in ECMWF's tables
128, 140 and 228 and NCEP's table 2 for edition 1.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from pipeline.texts import table_beside

Pair = tuple[str, str]
"""Names of an eastward component and its partner, or of a speed and its direction; of a quantity
without direction twice the same name."""

EAST = "eastward"
NORTH = "northward"
SPEED = "speed"
DIRECTION = "direction"
SIZE = "size"

# Units of speed, in m/s, by their spelling once words are symbols and "per" is a stroke.
_SPEEDS = {
    "m/s": 1.0,
    "cm/s": 0.01,
    "mm/s": 0.001,
    "km/h": 1 / 3.6,
    "kph": 1 / 3.6,
    **dict.fromkeys(("knot", "kt", "kn", "international_knot", "nmi/h", "nm/h"), 1852 / 3600),
}
_HEIGHTS = {"m": 1.0, "cm": 0.01, **dict.fromkeys(("ft", "foot", "feet"), 0.3048)}
_UNITS = {"m/s": _SPEEDS, "m": _HEIGHTS, "s": {"s": 1.0}}


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity that a file may have a field of.

    Attributes
    ----------
    name : as a message calls it.
    standard_names, polar_names, variable_names : pairs of names, in the order of preference.
    called : patterns of what a file calls the first component, and the second.
    units : units in m/s, m or s, by their spelling, and `unit`, the one meant.
    examples : units that a message names.
    most : largest value that there can be, m/s or m: a larger one is a fill value or another unit.
    grib : components by their parameter: a number in edition 1, with the version of a centre's own
        table; discipline, category and number in edition 2.
    grib_names : of each component the name, the standard name and the unit.
    grib_text : the parameters, as a message names them.
    levels : levels of GRIB that are taken before others; empty for the sea's surface.
    height_m : height over ground, m, of a wind; 0 for what the sea's surface has.
    kinds : what a field may be of its step, by GRIB's names.
    """

    name: str
    standard_names: tuple[Pair, ...]
    variable_names: tuple[Pair, ...]
    unit: str
    units: Mapping[str, float]
    examples: str
    most: float
    grib: Mapping[tuple[int, ...], str]
    grib_names: Mapping[str, tuple[str, ...]]
    grib_text: str
    polar_names: tuple[Pair, ...] = ()
    called: tuple[str, ...] = ()
    levels: tuple[tuple[str, float], ...] = ()
    height_m: float = 0.0
    kinds: Collection[str] = ("instant", "avg")

    @property
    def is_current(self) -> bool:
        """Whether it is the current of the water."""
        return self.name == CURRENT.name


def _quantities() -> Iterator[Quantity]:
    for name, row in table_beside(__file__, "quantities.toml").items():
        for key in {"standard_names", "polar_names", "variable_names"} & row.keys():
            row[key] = tuple((one, one) if isinstance(one, str) else tuple(one) for one in row[key])
        row["levels"] = tuple(map(tuple, row.get("levels", ())))
        grib = row.pop("grib")
        about = ("name", "standard_name", "unit")
        yield Quantity(
            name=name,
            units=_UNITS[row["unit"]],
            grib={tuple(key): part for part, own in grib.items() for key in own["parameters"]},
            grib_names={part: tuple(own[key] for key in about) for part, own in grib.items()},
            **row,
        )


QUANTITIES = tuple(_quantities())
CURRENT, WIND, GUST, WAVES, PERIOD = QUANTITIES
