"""Wind and waves over a limit: water shut for hours, figures, notes; or one clear line."""

import csv
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import geopandas
import numpy as np
import pytest
import shapely
import xarray as xr
from scipy.interpolate import RegularGridInterpolator

import renew
from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.findings.result import RunResult, adrift_notes, weather_notes
from pipeline.geo.projection import Projection
from pipeline.model import CurrentGrid
from pipeline.model.inputs import Credit
from pipeline.run import Outcome, run
from pipeline.scenario.catalogue import VesselLimits
from pipeline.scenario.loading import parse_scenario
from pipeline.stages.limits import limited_fields, over_limits, worst_met
from tests.pipeline.results import plain_pages, result_of
from tests.pipeline.sources.cf.grib_files import write_grib
from tests.pipeline.stages.test_avoided_areas import ISLAND

LON, LAT = np.arange(-40.15, -39.84, 0.025), np.arange(34.90, 35.16, 0.025)
HOURS = np.arange(0, 13)
BEGIN = np.datetime64("2026-11-22T06:00", "ns")
DEPARTURE = "2026-11-22T06:20:00Z"


def waves(*, worst: float, until: int = 4, everywhere: bool = False) -> xr.Dataset:
    """A sea of half a metre, and higher waves across the way in the first hours."""
    height = np.full((HOURS.size, LAT.size, LON.size), 0.5)
    across = np.abs(LON + 40.0) < (1.0 if everywhere else 0.03)
    height[:until, :, across] = worst
    axes = {
        "time": BEGIN + HOURS.astype("timedelta64[h]").astype("timedelta64[ns]"),
        "latitude": ("latitude", LAT, {"units": "degrees_north"}),
        "longitude": ("longitude", LON, {"units": "degrees_east"}),
    }
    about = {"units": "m", "standard_name": "sea_surface_wave_significant_height"}
    return xr.Dataset({"swh": (("time", "latitude", "longitude"), height, about)}, axes)


def scenario_data(folder: Path, **asked: object) -> dict[str, Any]:
    (folder / "island.geojson").write_text(shapely.to_geojson(ISLAND))
    return {
        "schema_version": 1,
        "name": "weather",
        "start": [-40.06, 35.0],
        "goal": [-39.94, 35.0],
        "vessel": {"length_m": 12.0, "speed_m_s": 4.1, "turn_rate_deg_s": 11.8},
        "region": {"bbox": [-40.09, 34.95, -39.91, 35.10]},
        "chart": {"source": {"path": "island.geojson", "accuracy_m": 10}},
        "planner": {"classes": 2},
        "seasons": [{"name": "still", "currents": ["still"], "departure": DEPARTURE}],
        **asked,
    }


def found(folder: Path, limits: dict[str, Any] | None, **asked: object) -> RunResult:
    given = {} if limits is None else {"limits": limits}
    scenario = parse_scenario(scenario_data(folder, **given, **asked), folder)
    return result_of(scenario, folder / "outputs")


def window(file: str = "waves.nc", wave_m: float = 1.2) -> dict[str, Any]:
    """Limits, and a season that leaves within some hours."""
    departures = {"first": DEPARTURE, "every": "2h", "count": 3}
    season = {"name": "still", "currents": ["still"], "departures": departures}
    return {"limits": {"waves": [file], "wave_m": wave_m}, "seasons": [season]}


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """Run with waves over the limit, and departures before and after they fall."""
    folder = tmp_path_factory.mktemp("waves")
    waves(worst=2.125).to_netcdf(folder / "waves.nc", engine="netcdf4")
    with plain_pages("report.page.write_report"):
        return run(parse_scenario(scenario_data(folder, **window()), folder), folder / "outputs")


def test_a_vessel_leaves_when_the_waves_are_low_enough(outcome: Outcome) -> None:
    assert outcome.exit_code == 0
    with (outcome.directory / "metrics.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert float(row["worst_wave_m"]) <= 1.2
    assert float(row["wave_headroom_m"]) == pytest.approx(1.2 - float(row["worst_wave_m"]))
    (worst,) = note_texts(weather_notes(outcome.result.routes[0]))
    assert worst.startswith("waves of up to 0.50 m on the best route, at ")
    assert re.search(r", 2026-11-22 .* UTC: 0\.70 m below the limit$", worst)
    # Shut until 10:00, half an hour from the start.
    departure = outcome.scenario.seasons[0].departure
    assert departure is not None
    assert f"{departure:%H:%M}" >= "10:20"
    shut = geopandas.read_file(outcome.directory / "routes.gpkg", layer="over_limit")
    assert (shut.worst == 2.125).all()
    assert (shut.shut_until == "2026-11-22T10:00Z").any()


def test_a_new_forecast_and_another_limit_are_planned_anew(tmp_path: Path) -> None:
    met = []
    for worst, most in ((1.0, 1.2), (2.1, 1.2), (2.1, 2.5)):
        waves(worst=worst).to_netcdf(tmp_path / "waves.nc", engine="netcdf4")
        routes = found(tmp_path, **window(wave_m=most)).routes
        met.append(routes[0].metrics.worst_wave_m)
    assert met == pytest.approx([1.0, 0.5, 2.1], abs=0.3)


def test_at_one_departure_the_reason_has_the_hours_and_the_height(tmp_path: Path) -> None:
    waves(worst=2.1).to_netcdf(tmp_path / "waves.nc", engine="netcdf4")
    scenario = parse_scenario(
        scenario_data(tmp_path, limits={"waves": ["waves.nc"], "wave_m": 1.2}), tmp_path
    )
    with pytest.raises(RequestError) as refused:
        run(scenario, tmp_path / "outputs")
    assert "water with waves of up to 2.1 m" in str(refused.value)
    assert "until 2026-11-22 10:00 UTC" in str(refused.value)


def test_a_limit_that_is_never_reached_gives_the_plan_without_it(tmp_path: Path) -> None:
    waves(worst=1.1).to_netcdf(tmp_path / "waves.nc", engine="netcdf4")
    with_limit, without = (found(tmp_path, limits).routes for limits in (window()["limits"], None))
    for one, other in zip(with_limit, without, strict=True):
        np.testing.assert_array_equal(one.route.trajectory, other.route.trajectory)
        assert one.route.fuel == other.route.fuel
        assert one.route.fuel_bound.value == other.route.fuel_bound.value


def test_a_vessel_adrift_is_carried_by_the_wind_too(tmp_path: Path) -> None:
    """In still water a wind of 10 m/s from the west carries it 0.3 m/s east."""
    shape = HOURS.size, LAT.size, LON.size
    names = {"u10": ("eastward_wind", 10.0), "v10": ("northward_wind", 0.0)}
    data = {
        name: (
            ("time", "latitude", "longitude"),
            np.full(shape, speed),
            {"units": "m s-1", "standard_name": standard},
        )
        for name, (standard, speed) in names.items()
    }
    wind = xr.Dataset(data, waves(worst=1.0).coords)
    wind.to_netcdf(tmp_path / "wind.nc", engine="netcdf4")
    (case,) = found(tmp_path, {"wind": ["wind.nc"], "leeway": 0.03}).cases
    adrift, land = case.measures.adrift[0], shapely.union_all(case.case.water.land)
    rays = shapely.linestrings(
        np.stack([adrift.points, np.add(adrift.points, [40_000.0, 0.0])], axis=1)
    )
    met = shapely.intersects(rays, land)
    assert met.any()
    expected = shapely.distance(shapely.points(adrift.points), shapely.intersection(rays, land))
    known = met & (expected / 0.3 < 9 * 3600.0)
    assert known.sum() > 20
    assert np.median(np.abs(0.3 * adrift.seconds[known] / expected[known] - 1)) < 0.01
    (note,) = note_texts(adrift_notes(case.routes[0]))
    assert note.startswith("without thrust the current and the wind carry the vessel ashore in")


def test_with_members_the_share_that_exceeds_a_limit_is_told(tmp_path: Path) -> None:
    """Waves that rise when half of the members' vessels have arrived."""
    waves(worst=1.0).to_netcdf(tmp_path / "waves.nc", engine="netcdf4")
    season = {"name": "still", "currents": ["still"], "departure": DEPARTURE}
    seasons = [{**season, "members": {"spread": 0.3, "count": 4}}]
    ranked = found(tmp_path, {"waves": ["waves.nc"], "wave_m": 1.2}, seasons=seasons).routes[0]
    assert ranked.metrics.members_over_limit_share == 0.0
    case, (field,) = ranked.case.case, ranked.case.case.weather
    assert case.members is not None
    ends = [
        renew.fuel(ranked.route.path, one, case.vessel, chart=case.chart) / case.vessel.fuel_rate
        for one in case.members.currents
    ]
    rises = float(np.median(ends))
    times, shape = np.array([0.0, rises - 0.1, rises + 0.1, 1e5]), field.values.shape[1:]
    values = np.array([0.0, 0.0, 2.4, 2.4])[:, None, None] * np.ones(shape)
    case = replace(case, weather=(replace(field, times_s=times, values=values),))
    share = worst_met(case, ranked.route, "projected")["members_over_limit_share"]
    assert share == pytest.approx(np.mean(np.array(ends) > rises))


def test_grib_and_netcdf_give_the_same_areas(outcome: Outcome, tmp_path: Path) -> None:
    write_grib(tmp_path / "waves.grb", waves(worst=2.125), 2)
    routes = found(tmp_path, **window("waves.grb")).routes
    for one, other in zip(routes, outcome.result.routes, strict=True):
        np.testing.assert_array_equal(one.route.trajectory, other.route.trajectory)


def test_limits_without_files_and_files_without_limits_are_refused(tmp_path: Path) -> None:
    for limits, said in (
        ({"wave_m": 1.2}, r"has limits.wave_m, but no limits.waves"),
        ({"waves": ["w.nc"]}, r"has limits.waves, and neither \[limits\] nor the vessel"),
    ):
        with pytest.raises(RequestError, match=said):
            parse_scenario(scenario_data(tmp_path, limits=limits), tmp_path)
    seasons = [{"name": "still", "currents": ["still"]}]
    given: dict[str, object] = {"waves": ["w.nc"], "wave_m": 1.2}
    with pytest.raises(RequestError, match=r"no 'departure', from which the hours of \[limits\]"):
        parse_scenario(scenario_data(tmp_path, limits=given, seasons=seasons), tmp_path)


def field(values: FloatArray) -> CurrentGrid:
    """Values (nt, ny, nx) as a source gives them."""
    lon, lat = np.linspace(10.0, 11.0, values.shape[2]), np.linspace(50.0, 50.6, values.shape[1])
    times = np.arange(0.0, 3600.0 * values.shape[0], 3600.0)
    about = Credit("test", "current", "", "")
    zero = np.zeros_like(values)
    return CurrentGrid("one", lon, lat, values, zero, "", about, times_s=times)


@pytest.mark.parametrize("size", [12, 130])
def test_in_open_water_no_value_between_nodes_and_hours_is_over_the_limit(size: int) -> None:
    """Also where cells of a fine field are joined; held against an interpolation of its own."""
    rng = np.random.default_rng(size)
    x, y = np.linspace(0, 1, size), np.linspace(0, 1, size)
    values = np.array(
        [
            2.5 * np.exp(-(((x[None] - 0.1 * k) ** 2 + (y[:, None] - 0.5) ** 2) / 0.03))
            for k in range(8)
        ]
    )
    values += rng.uniform(0, 0.2, values.shape)
    grid = field(values)
    (limited,) = limited_fields({"wave_m": grid}, VesselLimits(wave_m=1.2))
    projection = Projection.for_region(shapely.box(10, 50, 11, 50.6))
    extent = shapely.Polygon(
        projection.to_plane(
            np.array([[10.02, 50.02], [10.98, 50.02], [10.98, 50.58], [10.02, 50.58]])
        )
    )
    areas = list(over_limits([limited], projection, extent))
    known = [area for area in areas if np.isfinite(area.most)]
    (unknown,) = (area for area in areas if not np.isfinite(area.most))
    assert unknown.begin == 7 * 3600.0
    assert len(known) < 12_000
    places = np.column_stack([rng.uniform(10.02, 10.98, 20_000), rng.uniform(50.02, 50.58, 20_000)])
    times = rng.uniform(0, 7 * 3600.0, len(places))
    truth = RegularGridInterpolator((grid.times_s, grid.lat, grid.lon), values)
    over = truth(np.column_stack([times, places[:, 1], places[:, 0]])) > 1.2
    tree = shapely.STRtree([area.polygon for area in known])
    point, area = tree.query(shapely.points(projection.to_plane(places)), predicate="intersects")
    begin, end = (np.array([getattr(one, name) for one in known]) for name in ("begin", "end"))
    now = times[point]
    shut = np.zeros(len(places), dtype=bool)
    shut[point[(begin[area] <= now) & (now <= end[area])]] = True
    assert over.sum() > 500
    assert not (over & ~shut).any()
    assert shut.mean() < over.mean() + 0.35


def test_a_case_with_a_later_clock_keeps_its_weather() -> None:
    area = renew.OverLimit(ISLAND, 600.0, 1200.0, "waves", 2.1, "m")
    later = replace(area, begin=area.begin - 500.0, end=area.end - 500.0)
    assert isinstance(later, renew.OverLimit)
    assert (later.begin, later.end, later.most) == (100.0, 700.0, 2.1)
