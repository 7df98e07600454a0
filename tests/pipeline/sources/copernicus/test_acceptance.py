"""The acceptance check: a valid file is accepted unchanged, and every defect is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st

from pipeline.errors import StageError
from pipeline.model import Credit, Land
from pipeline.scenario.catalogue import CopernicusSpec
from pipeline.scenario.season import period
from pipeline.sources.cf.axes import TimeSteps
from pipeline.sources.cf.fields import SelectedSteps
from pipeline.sources.copernicus.adapter import accept, largest_spike
from pipeline.sources.copernicus.download import SubsetRequest, select
from pipeline.sources.current_field import Field
from tests.pipeline import synthetic_currents

REGION = shapely.box(117, 8, 120, 11)
ISLAND = shapely.box(118, 9, 119.5, 10.5)
LAND = Land((ISLAND,), (Credit("an island", "land", "", ""),), 0.0)
STEP = 1 / 12
SPEC = CopernicusSpec(
    schema_version=1,
    name="monthly",
    title="Months",
    adapter="copernicus",
    credit="",
    licence="",
    product="",
    doi="",
    dataset="",
    step="month",
    kind="mean",
    covers="",
    cell_deg=STEP,
    speed_limit_m_s=3.0,
)
MONTH = SubsetRequest(SPEC, REGION, *select(SPEC, period("2024-07"), "mean"))
DAYS = SubsetRequest(
    SPEC.model_copy(update={"step": "day"}),
    REGION,
    TimeSteps(labels=("2024-07-01", "2024-07-02", "2024-07-03")),
    SelectedSteps(weights=({0: 0.5, 1: 0.25, 2: 0.25},), valid=""),
)


def field(step: float = STEP, region: tuple[float, ...] = REGION.bounds) -> Field:
    """Make a plausible field around the island: a smooth current, NaN on land."""
    west, south, east, north = region
    margin = 2 * step
    lon = np.arange(west - margin, east + margin + step / 2, step)
    lat = np.arange(south - margin, north + margin + step / 2, step)
    x, y = np.meshgrid(lon, lat)
    u, v = 0.4 * np.sin(x) + 0.1, 0.3 * np.cos(y)
    on_land = shapely.contains_xy(ISLAND, x, y)
    u[on_land] = v[on_land] = np.nan
    return Field(lon, lat, u, v)


def write(
    path: Path,
    *steps: Field,
    time_value: float = 0.0,
    units: str = "m s-1",
    names: tuple[str, str] = ("uo", "vo"),
    depth: tuple[float, ...] = (0.494025,),
) -> Path:
    """Write days as the service does: along time, depth, latitude, longitude; packed."""
    first = np.datetime64("2024-07-01T00:00") + np.timedelta64(round(60 * time_value), "m")
    times = [first + np.timedelta64(day, "D") for day in range(len(steps))]
    data = synthetic_currents.dataset(*steps, times=times, names=names, units=units)
    packed: dict[str, Any] = {"dtype": "i2", "scale_factor": 6.1e-4, "_FillValue": -32767}
    encoding = dict.fromkeys(names, packed)
    encoding |= {axis: {"dtype": "f4"} for axis in ("latitude", "longitude", "depth")}
    return synthetic_currents.write(path, data.expand_dims(depth=depth, axis=1), **encoding)


def test_a_valid_file_is_accepted_unchanged(tmp_path: Path) -> None:
    made = field()
    read, _ = accept(write(tmp_path / "valid.nc", made), MONTH, (), LAND)
    assert np.allclose(read.lon, made.lon, atol=1e-5)
    assert np.allclose(read.lat, made.lat, atol=1e-5)
    assert np.allclose(read.u, made.u, atol=4e-4, equal_nan=True)
    assert np.allclose(read.v, made.v, atol=4e-4, equal_nan=True)


def test_descending_latitudes_and_other_longitudes_are_the_same_field(tmp_path: Path) -> None:
    made = field()
    other = Field(made.lon - 360, made.lat[::-1], made.u[::-1], made.v[::-1])
    read, _ = accept(write(tmp_path / "other.nc", other), MONTH, (), LAND)
    expected, _ = accept(write(tmp_path / "made.nc", made), MONTH, (), LAND)
    assert np.allclose(read.lon, expected.lon, atol=1e-4)
    assert np.allclose(read.lat, expected.lat)
    assert np.array_equal(read.u, expected.u, equal_nan=True)


def _shifted(cells: int) -> Field:
    made = field()
    return replace(made, u=np.roll(made.u, cells, axis=1), v=np.roll(made.v, cells, axis=1))


def _with_a_spike(by: float) -> Field:
    made = field()
    made.u[4, 5] += by
    return made


def _without_a_chunk() -> Field:
    made = field()
    u, v = made.u.copy(), made.v.copy()
    u[:10, :20] = v[:10, :20] = np.nan
    return replace(made, u=u, v=v)


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (field, {"time_value": 24 * 40}, "times are ['2024-08'], not ['2024-07']"),
        (field, {"units": "km h-1"}, "uo is in 'km h-1', not m/s"),
        (field, {"names": ("ugos", "vgos")}, "no variable 'uo'"),
        (field, {"names": ("vo", "uo")}, "not the eastward velocity"),
        (field, {"depth": (0.5, 1.5)}, "not the surface alone"),
        (field, {"depth": (92.3,)}, "not the surface alone"),
        (lambda: field(step=0.25), {}, "longitude steps by 0.25"),
        (lambda: field(region=(117, 8, 119, 11)), {}, "it has no data east of 119.2"),
        (lambda: field(region=(117, 9, 120, 11)), {}, "it has no data south of 8.79"),
        (lambda: replace(field(), u=field().u * 10), {}, "at 2024-07 speeds reach"),
        (lambda: _with_a_spike(1.5), {}, "stands out from its neighbours by 1"),
        (lambda: _with_a_spike(-0.5), {}, "stands out from its neighbours by 0.4"),
        (lambda: replace(field(), u=field().u * 0, v=field().v * 0), {}, "every speed is 0"),
        (lambda: replace(field(), u=field().u * np.nan), {}, "gaps where the other has none"),
        (lambda: _shifted(6), {}, "the field is shifted"),
        (_without_a_chunk, {}, "a part was not delivered"),
    ],
)
def test_every_defect_is_refused_with_its_reason(
    tmp_path: Path, make: Callable[[], Field], options: dict[str, Any], message: str
) -> None:
    path = write(tmp_path / "bad.nc", make(), **options)
    with pytest.raises(StageError) as caught:
        accept(path, MONTH, (), LAND)
    assert "bad.nc" in str(caught.value)
    assert message in str(caught.value)


# --- several time steps -------------------------------------------------------------------------


def _days() -> list[Field]:
    """Make three days with different currents."""
    made = field()
    return [made, replace(made, u=0.5 * made.u), replace(made, u=-made.u, v=made.v + 0.1)]


def test_the_steps_are_summed_by_their_weights(tmp_path: Path) -> None:
    first, second, third = _days()
    read, _ = accept(write(tmp_path / "days.nc", first, second, third), DAYS, (), LAND)
    u = 0.5 * first.u + 0.25 * second.u + 0.25 * third.u
    v = 0.5 * first.v + 0.25 * second.v + 0.25 * third.v
    assert np.allclose(read.u, u, atol=4e-4, equal_nan=True)
    assert np.allclose(read.v, v, atol=4e-4, equal_nan=True)


def test_missing_additional_and_unordered_steps_are_refused(tmp_path: Path) -> None:
    days = _days()
    for wrong in (days[:2], [*days, days[0]]):
        with pytest.raises(
            StageError, match=r"its times are \[.*2024-07-0[24].*not \['2024-07-01'"
        ):
            accept(write(tmp_path / "days.nc", *wrong), DAYS, (), LAND)
    steps = TimeSteps(labels=("2024-07-02", "2024-07-03", "2024-07-04"))
    with pytest.raises(StageError, match="its times are"):
        accept(write(tmp_path / "days.nc", *days), replace(DAYS, steps=steps), (), LAND)


@pytest.mark.parametrize("day", [0, 1, 2])
def test_a_gap_in_only_one_step_is_refused(tmp_path: Path, day: int) -> None:
    days = _days()
    days[day] = replace(days[day], u=days[day].u.copy(), v=days[day].v.copy())
    days[day].u[2, 3] = days[day].v[2, 3] = np.nan
    path = write(tmp_path / "hole.nc", *days)
    with pytest.raises(StageError, match="1 cells have gaps"):
        accept(path, DAYS, (), LAND)
    spec = DAYS.spec.model_copy(update={"gaps_vary": True})
    icy, _ = accept(path, replace(DAYS, spec=spec), (), LAND)
    assert np.isnan(icy.u[0, 2, 3]), "a gap in one step is a gap in the mean"


def test_an_impossible_speed_in_one_step_is_refused(tmp_path: Path) -> None:
    days = _days()
    days[1] = replace(days[1], u=days[1].u * 20)
    with pytest.raises(StageError, match="at 2024-07-02 speeds reach"):
        accept(write(tmp_path / "wild.nc", *days), DAYS, (), LAND)


# --- chunks that the service does not have ------------------------------------------------------


def test_a_missing_chunk_of_land_is_accepted(tmp_path: Path) -> None:
    path = write(tmp_path / "land.nc", field())
    for turn in (0, -360, 360):
        box = (118.1 + turn, 9.1, 119.4 + turn, 10.4)
        accept(path, MONTH, (box,), LAND)


@pytest.mark.parametrize(
    "box",
    [
        (119.99, 7.0, 122.0, 12.0),  # the region's last column
        (116.0, 10.99, 122.0, 12.0),  # its last row
        (118.1, 9.1, 119.4, 10.8),  # the island, and three rows beside it
    ],
)
def test_a_missing_chunk_with_a_little_water_is_refused(
    tmp_path: Path, box: tuple[float, float, float, float]
) -> None:
    path = write(tmp_path / "wet.nc", field())
    with pytest.raises(StageError, match=r"had no data for \d+ cells of water"):
        accept(path, MONTH, (box,), LAND)


def test_a_missing_chunk_outside_the_region_is_accepted(tmp_path: Path) -> None:
    path = write(tmp_path / "beyond.nc", field())
    accept(path, MONTH, ((120.1, 7.0, 122.0, 12.0),), LAND)


# --- spikes -------------------------------------------------------------------------------------


def test_real_fields_have_no_spikes(shared: Path) -> None:
    folder = shared / "data" / "currents"
    for name, components in (
        ("cmems_mod_glo_phy-cur_anfc_0.083deg_P1D-m_2024-01_1deg_5day.nc", ("uo", "vo")),
        ("cwb_ocm_M-B0071-000_20200617T00.nc", ("uo", "vo")),
        ("duacs_nrt_global_allsat_phy_l4_20190223_20190226.nc", ("ugos", "vgos")),
    ):
        with netCDF4.Dataset(folder / name) as dataset:
            for component in components:
                values = np.ma.filled(dataset[component][:].astype(float), np.nan)
                for layer in values.reshape(-1, *values.shape[-2:]):
                    assert largest_spike(layer, 1.0) == 0


@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.floats(0.35, 1e3),
    st.sampled_from([-1, 1]),
    st.integers(0, 99),
)
def test_a_spike_in_a_smooth_field_is_found(
    row: int, column: int, by: float, sign: int, phase: int
) -> None:
    x, y = np.meshgrid(np.arange(32), np.arange(32))
    values = 0.1 * np.sin(0.05 * x + phase) * np.cos(0.05 * y)
    assert largest_spike(values, 1.0) == 0
    values[row, column] += sign * by
    assert largest_spike(values, 1.0) == pytest.approx(by, abs=0.02)
