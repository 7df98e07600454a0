"""One sea, written in ways of which something must be guessed: what a reader may make of each.

The sea is a formula: `velocity`, gyres without divergence, times `growth` of the hours since
`EPOCH`. This is linear, so that a mean over some hours is the sea at their middle, and
interpolation is exact. Each file is right (to the formula's value at `DEPARTURE`), or what was
decided is said, or it is refused, mostly with a remedy that is followed here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, TypeAlias

import numpy as np
import xarray as xr

from pipeline._types import FloatArray
from tests.pipeline.synthetic_currents import EASTWARD, NORTHWARD

# Open water east of the Philippines.
LON, LAT = np.arange(130.0, 136.01, 0.25), np.arange(15.0, 20.01, 0.25)
EPOCH, DEPARTURE = datetime(2024, 3, 15, tzinfo=UTC), datetime(2024, 3, 15, 15, tzinfo=UTC)
HOURS = np.arange(-48.0, 73.0, 6.0)
DAYS = np.arange(-48.0, 73.0, 24.0)
POINT, MEAN = {"cell_methods": "time: point"}, {"cell_methods": "time: mean"}
Sea: TypeAlias = xr.Dataset


# Turns of gyres on a degree of longitude and of latitude, and their phases.
_GYRES = ((2.1, 0.4, 0.3), (-0.7, 1.9, 1.1), (1.3, 1.5, 2.0), (1.6, -1.2, 0.7))


def velocity(lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The sea at the hour 0, m/s to east and north, from a stream function."""
    u, v = np.zeros(lon.shape), np.zeros(lon.shape)
    for along, up, phase in _GYRES:
        slope = 0.15 * np.cos(along * (lon - 133.0) + up * (lat - 17.5) + phase)
        u -= up * slope
        v += along * slope / np.cos(np.radians(lat))
    return u, v


FIELD = velocity(*np.meshgrid(LON, LAT))


def growth(hours: FloatArray | float) -> FloatArray:
    """The factor of the sea at some hours."""
    return np.asarray(1.0 + np.asarray(hours) / 480.0)


@dataclass(frozen=True)
class Case:
    """A file, and what must come of it.

    The note `said`, or the refusal `refused`, has these words; without both nothing is said. The
    current is that of the hour `hours`, by default of `DEPARTURE`, times `share`. After the remedy
    was followed it is right, whatever is said. `within` is what interpolation may change, m/s.
    """

    make: Callable[[], Sea]
    said: str = ""
    refused: str = ""
    follow: Callable[[Sea], Sea] | None = None
    hours: float = 15.0
    share: float = 1.0
    name: str = "sea.nc"
    within: float = 1e-6


def at(
    hours: Any = HOURS,  # noqa: ANN401 - any array of numbers
    *,
    stamps: Any = None,  # noqa: ANN401 - as above
    units: str = "hours since 2024-03-15 00:00:00",
    names: tuple[str, str] = ("uo", "vo"),
    standard: tuple[str, str] = (EASTWARD, NORTHWARD),
    about: Mapping[str, str] = POINT,
    **attributes: Any,
) -> Sea:
    """Return the sea at some hours, stamped otherwise if `stamps` are given."""
    axes = ("time", "lat", "lon")
    parts = {
        name: (
            axes,
            growth(hours)[:, None, None] * part,
            {"units": "m s-1", **({"standard_name": said} if said else {}), **about},
        )
        for name, said, part in zip(names, standard, FIELD, strict=True)
    }
    coordinates = {
        "time": ("time", hours if stamps is None else stamps, {"units": units}),
        "lat": ("lat", LAT, {"standard_name": "latitude", "units": "degrees_north"}),
        "lon": ("lon", LON, {"standard_name": "longitude", "units": "degrees_east"}),
    }
    return xr.Dataset(parts, coordinates, attributes)


def called(u: str, **keys: str) -> Callable[[], Sea]:
    """Return a maker of `u` and `v` without a standard name, that are called something."""
    about = {**POINT, "long_name": u, **keys}
    return lambda: at(
        names=("u", "v"), standard=("", ""), about={k: v for k, v in about.items() if v}
    )


def renamed(data: Sea) -> Sea:
    """Correct the names of a current that is called something else."""
    for name in data.data_vars:
        plain = {key: data[name].attrs[key] for key in ("units", "cell_methods")}
        data[name].attrs = {**plain, "long_name": "velocity of the water"}
    return data


def part(share: float, names: tuple[str, str], standard: tuple[str, str] = ("", "")) -> Sea:
    """Return a part of the sea under other names."""
    data = at(names=names, standard=standard)
    for name in names:
        data[name] = (data[name] * share).assign_attrs(data[name].attrs)
    return data


SURFACE = (f"surface_{EASTWARD}", f"surface_{NORTHWARD}")


def merged(
    total: tuple[str, str] = ("utotal", "vtotal"),
    long_name: str = "",
    standard: tuple[str, str] = SURFACE,
) -> Sea:
    """Return circulation `uo`, tide, Stokes drift, and their total by its names."""
    tides, stokes = f"{EASTWARD}_due_to_tides", "sea_surface_wave_stokes_drift_x_velocity"
    parts = [
        part(0.5, ("uo", "vo"), (EASTWARD, NORTHWARD)),
        part(0.3, ("utide", "vtide"), (tides, tides.replace("east", "north"))),
        part(0.2, ("vsdx", "vsdy"), (stokes, stokes.replace("_x_", "_y_"))),
    ]
    if total[0]:
        parts.append(part(1.0, total, standard))
        parts[-1][total[0]].attrs["long_name"] = long_name
    return xr.merge(parts)


def levels(
    values: list[float], surface: int, dim: str = "depth", **attributes: str
) -> Callable[[], Sea]:
    """Return a maker of the sea on levels: at the surface as it is, and a fifth of it elsewhere."""

    def make() -> Sea:
        data = at()
        shares = xr.DataArray([1.0 if i == surface else 0.2 for i in range(len(values))], dims=dim)
        for name in data.data_vars:
            about = data[name].attrs
            data[name] = (data[name] * shares).transpose("time", dim, "lat", "lon")
            data[name].attrs = about
        return data.assign_coords({dim: (dim, np.array(values, float), attributes)})

    return make


def alone(level: int, dim: str) -> Callable[[Sea], Sea]:
    """Keep one level, as messages advise."""
    return lambda data: data.isel({dim: level}, drop=True)


def scalar(name: str, value: float, **attributes: str) -> Callable[[], Sea]:
    """Return a maker of the sea with a coordinate without a dimension."""
    return lambda: at().assign_coords({name: ((), value, attributes)})


def attribute(name: str, key: str, value: str) -> Callable[[Sea], Sea]:
    """Correct an attribute."""

    def follow(data: Sea) -> Sea:
        data[name].attrs[key] = value
        return data

    return follow


def in_zone(rest: str, ahead_h: float) -> Callable[[], Sea]:
    """Return a maker of the sea with times on a clock that is ahead of UTC."""
    return lambda: at(stamps=HOURS + ahead_h, units=f"hours since {rest}")


def to_utc(ahead_h: float) -> Callable[[Sea], Sea]:
    """Write times of a zone in UTC."""

    def follow(data: Sea) -> Sea:
        about = {"units": "hours since 2024-03-15 00:00:00"}
        return data.assign_coords(time=("time", data.time.values - ahead_h, about))

    return follow


def with_bounds(about: Mapping[str, str], offset: float) -> Sea:
    """Return the sea on days with bounds, stamped some hours after their middle."""
    data = at(DAYS + 12, stamps=DAYS + 12 + offset, about=about)
    data.time.attrs["bounds"] = "time_bnds"
    return data.assign(time_bnds=(("time", "side"), np.stack([DAYS, DAYS + 24], axis=1)))


def monthly() -> Sea:
    """Return monthly means of five months, stamped with the first of each."""
    firsts = [datetime(2024, month, 1, tzinfo=UTC) for month in range(1, 7)]
    stamps = np.array([(one - EPOCH) / timedelta(hours=1) for one in firsts])
    middles = (stamps[1:] + stamps[:-1]) / 2
    return at(middles, stamps=stamps[:-1], about={})


def in_julian() -> Sea:
    """Return the sea with the calendar that OSCAR states."""
    data = at(units="hours since 2024-03-15 00:00:00")
    data.time.attrs["calendar"] = "julian"
    return data


def auxiliary(**dims: str) -> Sea:
    """Return the sea along dimensions that have other names than their coordinates."""
    data = at()
    return data.rename_dims(dims).reset_coords(drop=False).set_coords(list(dims))


def turned() -> Sea:
    """Return the sea on a grid that is turned by 30 degrees, with components along its lines."""
    i, j = np.meshgrid(np.arange(-50, 51) / 20, np.arange(-50, 51) / 20)
    angle = np.radians(30.0)
    lat = 17.5 + i * np.sin(angle) + j * np.cos(angle)
    lon = 133.0 + (i * np.cos(angle) - j * np.sin(angle)) / np.cos(np.radians(17.5))
    east, north = velocity(lon, lat)
    # The lines' own direction, which differs from 30 degrees with the latitude.
    own = np.arctan2(
        np.sin(angle), np.cos(angle) * np.cos(np.radians(lat)) / np.cos(np.radians(17.5))
    )
    factors = growth(HOURS)[:, None, None]
    axes = ("time", "y", "x")
    data = {
        "uo": (axes, factors * (east * np.cos(own) + north * np.sin(own))),
        "vo": (axes, factors * (north * np.cos(own) - east * np.sin(own))),
        "nav_lon": (("y", "x"), lon),
        "nav_lat": (("y", "x"), lat),
    }
    found = xr.Dataset(data, {"time": ("time", HOURS, {"units": "hours since 2024-03-15 00:00"})})
    for name, standard in (("uo", "sea_water_x_velocity"), ("vo", "sea_water_y_velocity")):
        found[name].attrs = {"standard_name": standard, "units": "m s-1", **POINT}
    return found


def on_rotated_pole() -> Sea:
    """Return the sea on a grid that has a pole of its own."""
    return (
        at()
        .rename(lat="rlat", lon="rlon")
        .assign_coords(
            rlat=("rlat", LAT, {"standard_name": "grid_latitude", "units": "degrees_north"}),
            rlon=("rlon", LON, {"standard_name": "grid_longitude", "units": "degrees_east"}),
        )
    )


def with_mapping(data: Sea) -> Sea:
    """Give the components a mapping with a pole of its own, whatever the axes say."""
    about = {"grid_mapping_name": "rotated_latitude_longitude"}
    for name in ("uo", "vo"):
        data[name].attrs["grid_mapping"] = "pole"
    return data.assign(pole=((), 0, about))


def without_mapping(array: xr.DataArray) -> xr.DataArray:
    """Take the mapping away."""
    attributes = {key: own for key, own in array.attrs.items() if key != "grid_mapping"}
    return array.drop_attrs().assign_attrs(attributes)


UP, DOWN = {"positive": "up"}, {"positive": "down"}
NUMBER = {"standard_name": "model_level_number", "units": "1"}
SIGMA = {"standard_name": "ocean_sigma_coordinate"}
_TOP = alone(-1, "lev")
_WIND = "10 metre U wind component"

CASES: dict[str, Case] = {
    "plain": Case(at),
    "at the surface, by its standard name": Case(lambda: at(standard=SURFACE)),
    # What is a current.
    "u and v": Case(lambda: at(names=("u", "v"), standard=("", "")), said="by their names alone"),
    "water_u": Case(called("Eastward Water Velocity"), said="calls 'Eastward Water Velocity'"),
    "a wind's long_name": Case(called(_WIND), refused=_WIND, follow=renamed),
    "a wind's description": Case(
        called("", description="x-wind component"), refused="x-wind", follow=renamed
    ),
    "a wind's var_desc": Case(called("", var_desc="u-wind"), refused="u-wind", follow=renamed),
    "a wind's GRIB name": Case(called("", GRIB_name="U wind"), refused="U wind", follow=renamed),
    "a wind's standard name": Case(
        lambda: at(names=("u", "v"), standard=("eastward_wind", "northward_wind")),
        refused="u (eastward_wind)",
    ),
    "a wind that is called water, too": Case(
        lambda: at(about={**POINT, "long_name": _WIND}), refused=_WIND, follow=renamed
    ),
    "ice": Case(called("Eastward sea ice velocity"), refused="sea ice", follow=renamed),
    "ice by its standard name": Case(
        lambda: at(standard=("sea_ice_x_velocity", "sea_ice_y_velocity")), refused="sea_ice_x"
    ),
    "Stokes drift": Case(called("Stokes drift U"), refused="Stokes drift U", follow=renamed),
    "a wave-induced current": Case(
        called("Wave-induced surface current"), refused="Wave-induced", follow=renamed
    ),
    "a standard deviation": Case(
        called("Standard deviation of the eastward current"), refused="deviation", follow=renamed
    ),
    "a volume's transport": Case(
        called("eastward volume transport per width"), refused="transport", follow=renamed
    ),
    "wind stress in m/s": Case(called("Eastward wind stress"), refused="stress", follow=renamed),
    "air": Case(called("zonal air velocity"), refused="zonal air", follow=renamed),
    "a wind-driven current": Case(
        called("Wind-driven current"), said="calls 'Wind-driven current'"
    ),
    "a total with waves": Case(
        lambda: at(about={**POINT, "long_name": "Total current (Eulerian + waves + tide)"}),
        said="calls 'Total current (Eulerian + waves + tide)'",
    ),
    "a tide alone": Case(
        lambda: at(about={**POINT, "long_name": "Tidal velocity"}), said="calls 'Tidal velocity'"
    ),
    "a current without waves": Case(called("Current without waves"), said="without waves"),
    # Which pair.
    "merged": Case(
        lambda: merged(long_name="Total velocity (Eulerian + waves + tide)"),
        said="current is utotal and vtotal of the file, which the file calls 'Total velocity",
    ),
    "merged, a total by name": Case(merged, said="utotal and vtotal of the file, not uo, utide"),
    "merged, a sum": Case(
        lambda: merged(("ucur", "vcur"), "Sum of circulation, tide and waves"),
        said="is ucur and vcur",
    ),
    "merged, a total of the same standard name": Case(
        lambda: merged(standard=(EASTWARD, NORTHWARD)), said="is utotal and vtotal"
    ),
    "merged, a total without one": Case(
        lambda: merged(standard=("", "")), said="is utotal and vtotal of the file, by their names"
    ),
    "merged without a total": Case(
        lambda: merged(("", "")),
        said="uo and vo of the file, not utide, vtide, vsdx, vsdy",
        share=0.5,
    ),
    "merged, a total that nothing names": Case(
        lambda: xr.merge([at(), part(0.8, ("u_total", "v_total"))]),
        said="uo and vo of the file, not u_total, v_total",
    ),
    "geostrophic beside the whole": Case(
        lambda: xr.merge([at(), part(0.8, ("ug", "vg"), (f"geostrophic_{EASTWARD}", ""))]),
        said="uo and vo of the file, not ug",
    ),
    "two of one standard name": Case(
        lambda: xr.merge([at(names=("ua", "va")), part(0.8, ("ub", "vb"), (EASTWARD, NORTHWARD))]),
        refused="keep one pair",
        follow=lambda data: data.drop_vars(["ub", "vb"]),
    ),
    # Instants and means.
    "days from 00:00": Case(
        lambda: at(DAYS + 12, stamps=DAYS, about=MEAN), said="read as means (time: mean)"
    ),
    "days at noon": Case(lambda: at(DAYS + 12, about=MEAN)),
    "days from 00:00, float32": Case(
        lambda: at(
            DAYS + 12,
            stamps=(27102 + DAYS / 24).astype("f4"),
            units="days since 1950-01-01",
            about=MEAN,
        ),
        said="read as means (time: mean)",
    ),
    "P1D-m": Case(
        lambda: at(DAYS + 12, stamps=DAYS, about={}, id="cmems_mod_glo_phy_anfc_0.083deg_P1D-m"),
        said="read as means (P1D-m)",
    ),
    "P1D-m by the file's name": Case(
        lambda: at(DAYS + 12, stamps=DAYS, about={}),
        said="read as means (P1D-m)",
        name="cmems_mod_glo_phy_anfc_0.083deg_P1D-m_uo-vo_118.00E.nc",
    ),
    "PT1H-m": Case(
        lambda: at(np.arange(30) + 0.5, stamps=np.arange(30.0), about={}, id="x_PT1H-m"),
        said="read as means (PT1H-m)",
    ),
    "PT1H-m at the middle": Case(lambda: at(np.arange(30) + 0.5, about={}, id="x_PT1H-m")),
    "PT6H-i": Case(lambda: at(about={}, id="x_PT6H-i")),
    "means of an area": Case(lambda: at(about={"cell_methods": "area: mean time: point"})),
    "bounds": Case(lambda: with_bounds({}, -12.0)),
    "bounds, stamped at the end": Case(lambda: with_bounds(MEAN, 12.0)),
    "months": Case(monthly, said="read as means (the first of each month)"),
    "no sign": Case(lambda: at(about={}), said="read as instants"),
    "days without a sign": Case(
        lambda: at(DAYS + 12, stamps=DAYS, about={}), said="read as instants", hours=27.0
    ),
    "days from 06:00": Case(
        lambda: at(DAYS + 18, stamps=DAYS + 6, about=MEAN), said="read as instants", hours=27.0
    ),
    "largest": Case(
        lambda: at(about={"cell_methods": "time: maximum"}), refused="nor a mean (time: maximum)"
    ),
    "a spread of members": Case(
        lambda: at(about={"cell_methods": "realization: standard_deviation time: point"}),
        refused="nor a mean (realization: standard_deviation time: point)",
    ),
    "largest of an area": Case(
        lambda: at(about={"cell_methods": "area: maximum time: point (interval: 1 hour)"}),
        refused="nor a mean (area: maximum",
    ),
    "means over depth": Case(
        lambda: at(about={"cell_methods": "depth: mean time: point"}), said="means over depth"
    ),
    "one time without a dimension": Case(
        lambda: attribute("time", "standard_name", "time")(at()).isel(time=8),
        refused="one time step, 2024-03-15",
    ),
    # Zones.
    "6 h behind": Case(in_zone("2024-3-15 0:0:0 -6:00", -6)),
    "6 h behind, a digit": Case(in_zone("2024-3-15 0:0 -6", -6)),
    "half an hour": Case(in_zone("2024-03-15T00:00:00+05:30", 5.5)),
    "four digits": Case(in_zone("2024-03-15 00:00:00.0 -0930", -9.5)),
    "two blanks": Case(in_zone("2024-03-15  06:00:00  +1:00", -5)),
    "Z": Case(in_zone("2024-03-15T00:00:00Z", 0)),
    "UTC": Case(in_zone("2024-03-15 00:00 UTC", 0)),
    "EST": Case(in_zone("2024-03-15 00:00:00 EST", -5), refused="in UTC", follow=to_utc(-5)),
    "UTC+8": Case(in_zone("2024-03-15 00:00:00 UTC+8", 8), refused="in UTC", follow=to_utc(8)),
    "a zone beside a date": Case(
        in_zone("2024-3-15 -6:00", -6), refused="in UTC", follow=to_utc(-6)
    ),
    "an hour alone": Case(in_zone("2024-03-15T06", -6), refused="in UTC", follow=to_utc(-6)),
    "in the evening": Case(in_zone("2024-3-15 6:00 pm", -18), refused="in UTC", follow=to_utc(-18)),
    "the zone of time_zone": Case(
        lambda: attribute("time", "time_zone", "EST")(in_zone("2024-03-15 00:00", -5)()),
        refused="zone 'EST'",
        follow=to_utc(-5),
    ),
    "the zone of timezone": Case(
        lambda: attribute("time", "timezone", "America/Lima")(in_zone("2024-03-15 00:00", -5)()),
        refused="zone 'America/Lima'",
        follow=to_utc(-5),
    ),
    "local time": Case(
        lambda: attribute("time", "long_name", "Local time")(in_zone("2024-03-15 00:00", -5)()),
        refused="zone 'Local time'",
        follow=to_utc(-5),
    ),
    "a zone in a long_name": Case(
        lambda: attribute("time", "long_name", "Time (UTC-5)")(in_zone("2024-03-15 00:00", -5)()),
        refused="zone 'Time (UTC-5)'",
        follow=lambda data: attribute("time", "long_name", "UTC")(to_utc(-5)(data)),
    ),
    "a zone in a comment": Case(
        lambda: attribute("time", "comment", "JST")(in_zone("2024-03-15 00:00", 9)()),
        refused="comment as 'UTC'",
        follow=lambda data: attribute("time", "comment", "UTC")(to_utc(9)(data)),
    ),
    "a zone of the whole file": Case(
        lambda: in_zone("2024-03-15 00:00", -5)().assign_attrs(time_zone="EST"),
        refused="zone 'EST'",
        follow=lambda data: to_utc(-5)(data).assign_attrs(time_zone="UTC"),
    ),
    "time_zone +00:00": Case(lambda: attribute("time", "time_zone", "+00:00")(at())),
    "time_zone UTC": Case(lambda: attribute("time", "time_zone", "UTC")(at())),
    "Julian": Case(in_julian, said="though the file calls it julian"),
    # Levels.
    "numbers upwards": Case(levels([1, 2, 3, 4, 5], 4, "lev", **NUMBER, **UP)),
    "numbers downwards": Case(levels([1, 2, 3, 4, 5], 0, "lev", **NUMBER, **DOWN)),
    "numbers of no direction": Case(
        levels([1, 2, 3], 2, "lev", **NUMBER), refused="drop=True", follow=_TOP
    ),
    "numbers without attributes": Case(
        levels([1, 2, 3], 2, "lev"), refused="drop=True", follow=_TOP
    ),
    "one number": Case(levels([7], 0, "lev", **NUMBER, **UP), said="the only level, lev = 7"),
    "heights above the floor": Case(
        levels([1, 5, 20], 2, "lev", units="m", **UP), refused="drop=True", follow=_TOP
    ),
    "heights by their standard name": Case(
        levels([1, 5, 20], 2, "lev", units="m", standard_name="height_above_sea_floor"),
        refused="drop=True",
        follow=_TOP,
    ),
    "sigma": Case(levels([-0.9, -0.5, -0.1], 2, "lev", **SIGMA, **UP)),
    "sigma from the surface": Case(levels([0, -0.5, -1.0], 0, "lev", **SIGMA)),
    "sigma from 0 to 1": Case(levels([0.1, 0.5, 1.0], 0, "lev", **SIGMA, **DOWN)),
    "s_rho": Case(levels([-0.9, -0.1], 1, "s_rho", standard_name="ocean_s_coordinate_g2", **UP)),
    "s_rho from 0 to 1": Case(
        levels([0.1, 0.5, 1.0], 0, "s", standard_name="ocean_s_coordinate"),
        refused="isel(s=…, drop=True)",
        follow=alone(0, "s"),
    ),
    "s_rho without attributes": Case(
        levels([-0.9, -0.1], 1, "s_rho"), refused="keep one index", follow=alone(1, "s_rho")
    ),
    "elevations": Case(levels([-50, -10, 0], 2, units="m", **UP)),
    "depths from below": Case(levels([50, 10, 0.5], 2, units="m", **DOWN)),
    "depths without direction": Case(levels([0.5, 10], 0, units="m")),
    "depths without attributes": Case(
        levels([1, 2, 3], 2), refused="drop=True", follow=alone(2, "depth")
    ),
    "numbered depths": Case(
        levels([1, 2, 3], 2, units="level"), refused="drop=True", follow=alone(2, "depth")
    ),
    "metres without direction": Case(
        levels([10, 5, 0], 2, "lev", units="m"), refused="drop=True", follow=_TOP
    ),
    "negative depths": Case(
        levels([-50, -10, 0], 2, units="m", **DOWN),
        refused="does not say which is the surface",
        follow=alone(2, "depth"),
    ),
    "levels of air": Case(
        levels([1000, 850], 0, "lev", units="hPa", **DOWN),
        refused="850 hpa",
        follow=alone(0, "lev"),
    ),
    "feet": Case(levels([0, 30], 0, units="ft", **DOWN), refused="ft", follow=alone(0, "depth")),
    "one depth": Case(scalar("depth", 0.5, units="m", **DOWN)),
    "one depth, too deep": Case(scalar("depth", 50.0, units="m", **DOWN), refused="is 50 m deep"),
    "one depth below the surface": Case(
        scalar("depth", 5.0, units="m", **DOWN), said="from 5 m depth"
    ),
    "one height": Case(
        scalar("height", 10.0, units="m", **UP),
        refused="does not say which is the surface",
        follow=lambda data: data.drop_vars("height"),
    ),
    # Grids.
    "turned": Case(turned, said="turned from the lines of its grid", within=5e-3),
    "along the lines of lon and lat": Case(
        lambda: at(standard=("sea_water_x_velocity", "sea_water_y_velocity")),
        said="as east and north, although sea_water_x_velocity",
    ),
    "a pole of its own": Case(on_rotated_pole, refused="give the file with its lon and lat"),
    "a mapping of its own": Case(
        lambda: with_mapping(at()),
        refused="take pole away",
        follow=lambda data: data.drop_vars("pole").map(without_mapping),
    ),
    "index dimensions": Case(lambda: auxiliary(lat="y", lon="x")),
    "OSCAR's dimensions": Case(lambda: auxiliary(lat="latitude", lon="longitude")),
    "steps of cfgrib": Case(lambda: auxiliary(time="step")),
    "m/sec": Case(lambda: at(about={**POINT, "units": "m/sec"})),
}
