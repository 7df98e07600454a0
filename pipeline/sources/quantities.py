"""Quantities that the reader of fields knows: currents of water, wind, gusts and waves.

A quantity is a row: under which names files have it, in which units, and how large it can be. Names
are those of the CF conventions; of variables without a standard name, those of the models' own
files. GRIB's are in the WMO's Manual on Codes (FM 92), and in ECMWF's tables 128, 140 and 228 and
NCEP's table 2 for edition 1.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

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


@dataclass(frozen=True, eq=False)
class Quantity:
    """A quantity that a file may have a field of.

    Attributes
    ----------
    name : as a message calls it.
    standard_names, polar_names, variable_names : pairs of names, in the order of preference.
    units : units in m/s or m, by their spelling, and `unit`, the one meant.
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
    grib_names: Mapping[str, tuple[str, str, str]]
    grib_text: str
    polar_names: tuple[Pair, ...] = ()
    levels: tuple[tuple[str, float], ...] = ()
    height_m: float = 0.0
    kinds: frozenset[str] = frozenset({"instant", "avg"})

    @property
    def is_current(self) -> bool:
        """Whether it is the current of the water."""
        return self.name == CURRENT.name

    @property
    def has_direction(self) -> bool:
        """Whether it has two components."""
        return SIZE not in self.grib_names


CURRENT = Quantity(
    name="current",
    standard_names=tuple(
        (name, re.sub(r"(_|^)x_", r"\1y_", name.replace("eastward", "northward")))
        for name in (
            "eastward_sea_water_velocity",
            "surface_eastward_sea_water_velocity",
            "eastward_sea_water_velocity_assuming_no_tide",
            "sea_water_x_velocity",
            "surface_sea_water_x_velocity",
            "surface_geostrophic_eastward_sea_water_velocity",
            "geostrophic_eastward_sea_water_velocity",
            "x_sea_water_velocity",
        )
    ),
    # Of a direction: where the water goes to, or comes from.
    polar_names=tuple(
        (f"{surface}sea_water_speed", direction)
        for surface in ("", "surface_")
        for direction in (
            f"{surface}sea_water_velocity_to_direction",
            f"direction_of_{surface}sea_water_velocity",
            f"{surface}sea_water_velocity_from_direction",
        )
    ),
    variable_names=(
        *(("utotal", "vtotal"), ("uo", "vo"), ("ugos", "vgos"), ("u", "v"), ("water_u", "water_v")),
        *(("u_eastward", "v_northward"), ("ssu", "ssv"), ("uos", "vos"), ("vozocrtx", "vomecrty")),
        *(("ewct", "nsct"), ("ucur", "vcur"), ("ucurr", "vcurr"), ("uvel", "vvel")),
        *(("u_velocity", "v_velocity"), ("u-vel", "v-vel"), ("u_current", "v_current")),
        *(("mesh2d_ucx", "mesh2d_ucy"), ("horizontalvelx", "horizontalvely")),
    ),
    unit="m/s",
    units=_SPEEDS,
    examples="m s-1, cm s-1, km h-1 or knots",
    most=10.0,  # tides in the narrowest straits come near it, no water is faster
    grib={
        (49,): EAST,
        (50,): NORTH,
        (10, 1, 2): EAST,
        (10, 1, 3): NORTH,
        (47,): DIRECTION,
        (48,): SPEED,
        (10, 1, 0): DIRECTION,
        (10, 1, 1): SPEED,
    },
    # The direction of a current is that to which it runs.
    grib_names={
        EAST: ("uo", "eastward_sea_water_velocity", "m s-1"),
        NORTH: ("vo", "northward_sea_water_velocity", "m s-1"),
        SPEED: ("speed", "sea_water_speed", "m s-1"),
        DIRECTION: ("direction", "sea_water_velocity_to_direction", "degree"),
    },
    grib_text="the components of a current: 49 and 50 in GRIB 1, 10/1/2 and 10/1/3 in GRIB 2, or "
    "its direction and speed: 47 and 48, or 10/1/0 and 10/1/1",
)

# Where a file of many levels has the wind that a forecast for mariners gives.
_OVER_GROUND = (("heightAboveGround", 10.0), ("surface", 0.0))

WIND = Quantity(
    name="wind",
    standard_names=(("eastward_wind", "northward_wind"), ("x_wind", "y_wind")),
    # Of a direction: where the wind comes from, or blows to.
    polar_names=(("wind_speed", "wind_from_direction"), ("wind_speed", "wind_to_direction")),
    variable_names=(
        *(("u10", "v10"), ("10u", "10v"), ("u10m", "v10m"), ("u10n", "v10n"), ("u_10m", "v_10m")),
        *(("ugrd10m", "vgrd10m"), ("uwnd", "vwnd"), ("uas", "vas"), ("u_wind", "v_wind")),
        *(("ugrd_10maboveground", "vgrd_10maboveground"), ("eastward_wind", "northward_wind")),
        *(("wind_u", "wind_v"), ("wind_speed", "wind_direction")),
    ),
    unit="m/s",
    units=_SPEEDS,
    examples="m s-1, km h-1 or knots",
    most=120.0,  # the strongest that was measured at 10 m, in a cyclone, was 113 m/s
    grib={
        (33,): EAST,
        (34,): NORTH,
        (165, 128): EAST,
        (166, 128): NORTH,
        (0, 2, 2): EAST,
        (0, 2, 3): NORTH,
        (31,): DIRECTION,
        (32,): SPEED,
        (0, 2, 0): DIRECTION,
        (0, 2, 1): SPEED,
    },
    # The direction of a wind is that from which it blows.
    grib_names={
        EAST: ("u10", "eastward_wind", "m s-1"),
        NORTH: ("v10", "northward_wind", "m s-1"),
        SPEED: ("wind_speed", "wind_speed", "m s-1"),
        DIRECTION: ("wind_direction", "wind_from_direction", "degree"),
    },
    grib_text="the components of a wind: 33 and 34, or ECMWF's 165 and 166, in GRIB 1, 0/2/2 and "
    "0/2/3 in GRIB 2, or its direction and speed: 31 and 32, or 0/2/0 and 0/2/1",
    levels=_OVER_GROUND,
    height_m=10.0,
)

GUST = Quantity(
    name="gust",
    standard_names=(("wind_speed_of_gust", "wind_speed_of_gust"),),
    variable_names=tuple(
        (name, name) for name in ("i10fg", "fg10", "10fg", "10fg3", "gust", "gustsfc", "wind_gust")
    ),
    unit="m/s",
    units=_SPEEDS,
    examples="m s-1, km h-1 or knots",
    most=150.0,
    grib={(180,): SIZE, (49, 128): SIZE, (29, 228): SIZE, (0, 2, 22): SIZE},
    grib_names={SIZE: ("gust", "wind_speed_of_gust", "m s-1")},
    grib_text="gusts: 180, or ECMWF's 49 and 228029, in GRIB 1, 0/2/22 in GRIB 2",
    levels=_OVER_GROUND,
    height_m=10.0,
    kinds=frozenset({"instant", "avg", "max"}),
)

WAVES = Quantity(
    name="wave height",
    standard_names=(("sea_surface_wave_significant_height",) * 2,),
    variable_names=tuple(
        (name, name) for name in ("vhm0", "swh", "hs", "htsgw", "htsgwsfc", "hm0", "wave_height")
    ),
    unit="m",
    units=_HEIGHTS,
    examples="m, cm or ft",
    most=30.0,  # the highest significant height that was measured was 19 m
    grib={(100,): SIZE, (229, 140): SIZE, (10, 0, 3): SIZE},
    grib_names={SIZE: ("swh", "sea_surface_wave_significant_height", "m")},
    grib_text="significant heights of waves: 100, or ECMWF's 140229, in GRIB 1, 10/0/3 in GRIB 2",
)

PERIOD = Quantity(
    name="wave period",
    standard_names=(
        ("sea_surface_wave_period_at_variance_spectral_density_maximum",) * 2,
        ("sea_surface_wave_mean_period",) * 2,
    ),
    variable_names=tuple((name, name) for name in ("vtpk", "pp1d", "tp", "perpw", "mwp", "vtm10")),
    unit="s",
    units={"s": 1.0},
    examples="s",
    most=40.0,  # the wind raises no longer waves
    grib={(108,): SIZE, (231, 140): SIZE, (232, 140): SIZE, (10, 0, 34): SIZE, (10, 0, 11): SIZE},
    grib_names={
        SIZE: ("pp1d", "sea_surface_wave_period_at_variance_spectral_density_maximum", "s")
    },
    grib_text="periods of waves: 108, or ECMWF's 140231 and 140232, in GRIB 1, 10/0/34 and 10/0/11 "
    "in GRIB 2",
)

QUANTITIES = (CURRENT, WIND, GUST, WAVES, PERIOD)
