"""Official water levels: as h5py reads them, in zones that are never too high, at each hour."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import shapely

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.scenario.model import TideSpec
from pipeline.sources.cf.dataset import open_dataset
from pipeline.sources.tide_stations import Station, level_notes, stations_of
from pipeline.sources.water_levels import LevelZone, read_levels
from tests.pipeline.sources.cf.levels_files import write_s104

LON, LAT = np.arange(-71.05, -70.95, 0.004), np.arange(42.32, 42.36, 0.004)
# Hours from 2026-11-22.
HOURS = np.datetime64("2026-11-22", "s").astype(float) + 3600.0 * np.arange(49)
M2 = 2 * np.pi / (12.42 * 3600)


def levels(times: FloatArray = HOURS) -> FloatArray:
    """Return a tide (nt, ny, nx), m, that is half a metre lower, and later, in the east."""
    east = (LON - LON[0]) / np.ptp(LON)
    phase = M2 * (times[:, None] - HOURS[0]) - 0.3 * east
    row = 1.5 + 1.3 * np.cos(phase) - 0.5 * east
    return np.repeat(row[:, None, :], LAT.size, axis=1)


def value_at(zone: LevelZone, instants: FloatArray) -> FloatArray:
    """Return a zone's heights, m, at instants, s since 1970."""
    station = Station(zone.source, {}, zone=zone.area, series=zone.series)
    return station.tide(np.datetime64(0, "s")).heights(instants)


def test_the_levels_are_those_that_h5py_reads_and_zones_up_to_a_tenth_of_a_metre_lower(
    shared: Path,
) -> None:
    official = shared / "data" / "s100" / "104US004SC1BO_20251217T12Z.h5"
    read = open_dataset(official)["waterLevelHeight"].values
    with h5py.File(official) as file:
        instance = file["WaterLevel/WaterLevel.01"]
        raw = np.stack(
            [instance[name]["values"]["waterLevelHeight"] for name in sorted(instance)[:-1]]
        )
        origin, step = (
            [instance.attrs[f"grid{what}{name}"] for name in names]
            for what, names in (
                ("Origin", ("Longitude", "Latitude")),
                ("Spacing", ("Longitudinal", "Latitudinal")),
            )
        )
    fill = raw == np.float32(-9999)
    np.testing.assert_array_equal(np.where(fill, np.float32(np.nan), raw), read)
    zones = read_levels([official])
    assert {zone.datum for zone in zones} == {"MLLW"}
    held = np.zeros(raw.shape[1:], dtype=int)
    for zone in zones:
        shapely.prepare(zone.area)
        x, y = np.meshgrid(
            *(o + s * np.arange(n) for o, s, n in zip(origin, step, raw.shape[:0:-1], strict=True))
        )
        inside = shapely.contains_xy(zone.area, x, y)
        held += inside
        own = value_at(zone, zone.series[0])[:, None]
        apart = raw[:, inside & ~fill.any(axis=0)] - own
        assert apart.min(initial=0.0) > -1e-6
        assert apart.max(initial=0.0) <= 0.1 + 1e-6
    assert (held[~fill.any(axis=0)] == 1).all()


@pytest.mark.parametrize("edition", ["1.1", "2.0"])
def test_between_the_hours_levels_follow_the_tide_and_outside_the_lowest_counts(
    tmp_path: Path, edition: str
) -> None:
    about = {"productSpecification": f"INT.IHO.S-104.{edition}"}
    zones = read_levels([write_s104(tmp_path / "it.h5", (LON, LAT), HOURS, levels(), **about)])
    between = np.arange(HOURS[0], HOURS[-1], 600.0)
    true = levels(between)[:, 0]
    for zone in zones:
        columns = shapely.contains_xy(zone.area, LON, np.full(LON.size, LAT[3]))
        apart = true[:, columns] - value_at(zone, between)[:, None]
        # The spline of hours is off by 3 mm where it ends, and within by less than 1.
        assert apart.min() > -4e-3
        assert apart.max() < 0.104
        outside = np.array([HOURS[0] - 60.0, HOURS[-1] + 60.0, HOURS[-1] + 1e6])
        assert (value_at(zone, outside) <= zone.series[1].min()).all()
    assert shapely.union_all([zone.area for zone in zones]).covers(shapely.Point(-71.0, 42.34))


def test_a_later_forecast_wins_and_a_hole_is_refused(tmp_path: Path) -> None:
    early = write_s104(tmp_path / "00.h5", (LON, LAT), HOURS[:25], levels(HOURS[:25]))
    late = write_s104(
        tmp_path / "12.h5",
        (LON, LAT),
        HOURS[12:20],
        levels(HOURS[12:20]) - 0.2,
        issueTime="180000Z",
    )
    (zone, *_) = read_levels([early, late])
    column = np.flatnonzero(shapely.contains_xy(zone.area, LON, np.full(LON.size, LAT[3])))[0]
    true = levels(HOURS[:25])[:, 0, column]
    true[12:20] -= 0.2
    assert np.abs(true - value_at(zone, HOURS[:25]) - 0.05).max() <= 0.051
    far = write_s104(tmp_path / "far.h5", (LON, LAT), HOURS[40:], levels(HOURS[40:]))
    with pytest.raises(RequestError, match="no levels for 16 hours from 2026-11-23 on; give the"):
        read_levels([early, late, far])


def test_dry_nodes_beside_water_have_the_lowest_level_around(tmp_path: Path) -> None:
    given = levels()
    given[:, :, :4] = np.nan  # land
    given[5, 2, 10] = np.nan  # a flat that falls dry
    zones = read_levels([write_s104(tmp_path / "it.h5", (LON, LAT), HOURS, given)])
    water = shapely.union_all([zone.area for zone in zones])
    west = water.bounds[0]
    assert west == pytest.approx(LON[2] - 0.002)
    for zone in zones:
        for column in (2, 3):
            if zone.area.covers(shapely.Point(LON[column], LAT[4])):
                assert (zone.series[1] <= given[:, 4, 4] + 1e-6).all()
        if zone.area.covers(shapely.Point(LON[10], LAT[2])):
            assert zone.series[1][5] <= np.nanmin(given[:, 2, 10]) + 1e-6


def test_a_series_goes_to_other_processes_and_later_clocks(tmp_path: Path) -> None:
    zone = read_levels([write_s104(tmp_path / "it.h5", (LON, LAT), HOURS, levels())])[0]
    tide = Station("a", {}, zone=zone.area, series=zone.series).tide(np.datetime64("2026-11-22"))
    times = np.arange(0.0, 86400.0, 700.0)
    copy = pickle.loads(pickle.dumps(tide))  # noqa: S301 - our own
    assert isinstance(copy, renew.Tide)
    np.testing.assert_array_equal(copy.heights(times), tide.heights(times))
    later = replace(tide, epoch=np.datetime64("2026-11-22T03:00"))
    np.testing.assert_allclose(later.heights(times), tide.heights(times + 3 * 3600), atol=1e-9)


def test_a_gauge_that_is_too_high_for_water_beside_it_is_told(tmp_path: Path) -> None:
    path = write_s104(tmp_path / "it.h5", (LON, LAT), HOURS, levels())
    spec = TideSpec(stations=(str(path),))
    west = renew.Tide({}, 0.0, np.datetime64(0, "s"))
    assert west.heights(np.zeros(1)) == 0.0
    # The tide of the west as constants: S2's phase at midnight is 0, and M2's is not needed.
    gauge = Station(
        "West pier", {"M2": renew.Constant(1.3, _phase())}, (LON[0], LAT[5]), "MLLW", 1.5
    )
    texts = note_texts(level_notes((*stations_of(spec), gauge), 0.3))
    assert "from 2026-11-22 00:00 UTC until 2026-11-24 00:00 UTC" in texts[0]
    (told,) = (text for text in texts if "West pier" in text)
    share = float(re.findall(r"(\d+)% of the water", told)[0]) / 100
    most = float(re.findall(r"up to (\d\.\d+) m", told)[0])
    lower = (levels()[:, :, :1] - levels())[:, 0].max(axis=0)
    assert share == pytest.approx((lower > 0.3).mean(), abs=0.15)
    assert most == pytest.approx(lower.max(), abs=0.12)
    assert not any(
        "West pier" in text for text in note_texts(level_notes((*stations_of(spec), gauge), 1.0))
    )


def _phase() -> float:
    """Return M2's phase lag (degrees) for a high water at the first hour."""
    from renew.inputs.tide import arguments

    _, angle = arguments(["M2"], np.array([HOURS[0]], "datetime64[s]"))
    return float(np.degrees(angle[0, 0]) % 360)


@pytest.mark.parametrize(
    ("about", "text"),
    [
        ({"verticalDatum": np.int32(44)}, "its datum is 44, none of a chart; give S-104 over one"),
        ({"issueDate": "2026"}, "it has two steps of 2026-11-22"),
        ({"hours": 1}, "not of several hours on a grid; give S-104 of format 2"),
    ],
)
def test_levels_that_can_t_be_used_are_refused(
    tmp_path: Path, about: dict[str, object], text: str
) -> None:
    count = int(str(about.pop("hours", HOURS.size)))
    path, copy = (
        write_s104(tmp_path / name, (LON, LAT), HOURS[:count], levels()[:count], **about)
        for name in ("it.h5", "copy.h5")
    )
    with pytest.raises(RequestError, match=re.escape(text)):
        read_levels([path, copy] if "issueDate" in about else [path])
