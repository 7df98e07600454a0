"""Members of a forecast and their mean; tidal streams from constants, with a residual."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr

import renew
from pipeline.errors import RequestError
from pipeline.findings.note_words import note_text, note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.cf import fields as reading
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.harmonic_fit import fit_files
from pipeline.sources.current_field import Field, LandMask
from pipeline.sources.registry import current_source
from pipeline.stages.project import planar_current
from renew._types import FloatArray
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write
from tests.stream_scenes import (
    DEPARTURE,
    LAT,
    LON,
    REGION,
    basis,
    constants,
    fetched,
    plane,
    season,
    stream_scene,
    written,
)
from tests.tide_oracles import utide_sum

PALAWAN = shapely.box(118.3, 9.3, 119.2, 10.4)
MEMBER_LON, MEMBER_LAT = np.arange(108.0, 130.0, 0.25), np.arange(0.0, 20.0, 0.25)


@pytest.fixture(scope="module")
def seas(world_mask: LandMask) -> list[Field]:
    """Give three plausible seas around Palawan."""
    return [coastal(sea(MEMBER_LON, MEMBER_LAT, seed=seed), world_mask) for seed in (2, 3, 4)]


def current(paths: list[Path], **members: Any) -> CurrentGrid:
    """Read members as a season's current."""
    names = tuple(str(path) for path in paths)
    season = Season(name="summer", valid="2024-07", currents=(names,), members=members)
    source = current_source(names, season.members)
    if reason := source.uncovered_reason(PALAWAN, season):
        raise RequestError(reason)
    return source.current(PALAWAN, season, Land((), (), 0.0), Path())


def files(folder: Path, seas: list[Field]) -> list[Path]:
    return [write(folder / f"m{at}.nc", dataset(one)) for at, one in enumerate(seas)]


def test_each_file_is_a_member_and_the_current_is_their_mean(
    seas: list[Field], tmp_path: Path
) -> None:
    paths = files(tmp_path, seas)
    alone = [Season(name="one", valid="2024-07", currents=((str(path),),)) for path in paths]
    grids = [
        current_source(one.currents[0]).current(PALAWAN, one, Land((), (), 0.0), Path())
        for one in alone
    ]
    found = current(paths, along="files", weights=[1.0, 1.0, 2.0])
    assert [one.name for one in found.members] == ["m0", "m1", "m2"]
    assert [one.weight for one in found.members] == [0.25, 0.25, 0.5]
    for member, grid in zip(found.members, grids, strict=True):
        assert np.array_equal(member.u, grid.u, equal_nan=True)
    mean = (grids[0].v + grids[1].v + 2 * grids[2].v) / 4
    assert np.allclose(found.v, mean, equal_nan=True)
    assert {name for name, _ in found.files} == {"m0.nc", "m1.nc", "m2.nc"}


def test_members_along_a_dimension_are_those_of_files(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    together = xr.concat([dataset(one) for one in seas], "realization")
    path = write(tmp_path / "all.nc", together)
    by_file, by_index = current(paths, along="files"), current([path], along="realization")
    assert [one.name for one in by_index.members] == [f"realization {at}" for at in range(3)]
    for one, other in zip(by_file.members, by_index.members, strict=True):
        assert np.array_equal(one.u, other.u, equal_nan=True)
    assert np.allclose(by_file.u, by_index.u, equal_nan=True)
    with pytest.raises(RequestError, match=r"plan in all with members = \{ along = 'realization'"):
        current([path, path], along="files")
    with pytest.raises(RequestError, match=r"no dimension .member. for members\.along; it has"):
        current([path], along="member")


def test_a_member_that_fails_is_left_out_by_name(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    fast = Field(MEMBER_LON, MEMBER_LAT, 40 * seas[0].u, 40 * seas[0].v)
    other_nodes = sea(MEMBER_LON + 0.1, MEMBER_LAT, seed=5)
    paths += [
        write(tmp_path / "fast.nc", dataset(fast)),
        write(tmp_path / "shifted.nc", dataset(other_nodes)),
    ]
    found = current(paths, along="files")
    assert [one.name for one in found.members] == ["m0", "m1", "m2"]
    assert sum(one.weight for one in found.members) == pytest.approx(1)
    said = [note for note in note_texts(found.notes) if "was left out" in note]
    assert len(said) == 2
    assert "fast: fast.nc is refused" in said[0]
    assert "shifted has other longitudes than m0" in said[1]


def test_too_few_members_are_refused(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    with pytest.raises(RequestError, match="members: 1 file; there must be 2 to 200"):
        current(paths[:1], along="files")
    with pytest.raises(RequestError, match=r"members\.weights has 2 numbers for 3 members"):
        current(paths, along="files", weights=[1.0, 2.0])
    with pytest.raises(RequestError, match=r"members\.weights leave less than two members"):
        current(paths, along="files", weights=[0.0, 2.0, 0.0])
    with pytest.raises(RequestError, match=r"3 of 3 members can be used, and members\.choose"):
        current(paths, along="files", choose="p90")


# --- Tidal streams from harmonic constants: their sum, its steps, the residual, what is refused.


MIXED = {"M2": 0.8, "S2": 0.3, "K1": 0.2, "M4": 0.15, "MF": 0.05}


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file of five constituents and a mean."""
    return written(constants(MIXED, weak=-29.0), tmp_path_factory.mktemp("mixed") / "pass.nc")


def inside(data: xr.DataArray, grid: CurrentGrid) -> FloatArray:
    """Return the part of a file's field on a grid's nodes."""
    x, y = np.searchsorted(LON, grid.lon), np.searchsorted(LAT, grid.lat)
    return np.asarray(data.values[..., y, :][..., x])


def exact(path: Path, grid: CurrentGrid, times: FloatArray) -> FloatArray:
    """Return the sum (times, ny, nx, 2) by pyfes' heights, without the mean."""
    with xr.open_dataset(path) as data:
        shares = basis(tuple(map(str, data["constituent"].values)), times)
        parts = np.stack(
            [np.concatenate([inside(data[f"{c}_{part}"], grid) for part in ("re", "im")])
             for c in "uv"], axis=-1)  # fmt: skip
    return np.tensordot(shares.T, parts, axes=1)


def note_of(grid: CurrentGrid, kind: str) -> dict[str, object]:
    (found,) = [one for one in grid.notes if one.kind == kind]
    assert note_text(found)
    return dict(found.values)


# --- the sum ------------------------------------------------------------------------------------


def test_fields_and_the_lines_between_them_are_as_near_to_the_sum_as_is_said(mixed: Path) -> None:
    grid = fetched(season(mixed, residual="still"))
    told = note_of(grid, "tidal-streams")
    step_s, within = 60 * float(str(told["step_min"])), float(str(told["error_m_s"]))
    assert np.diff(grid.times_s) == pytest.approx(step_s)
    assert grid.times_s[0] <= -3600
    assert grid.times_s[-1] >= 30 * 3600
    assert 0.002 < within <= 0.03
    middles = (grid.times_s[1:] + grid.times_s[:-1]) / 2
    flow = np.stack([grid.u, grid.v], axis=-1)
    worst = 0.0
    for times, found in ((grid.times_s, flow), (middles, (flow[1:] + flow[:-1]) / 2)):
        off = np.linalg.norm(found - exact(mixed, grid, times), axis=-1)
        worst = max(worst, float(off.max()))
    assert within / 4 < worst <= within + 1e-4
    # The lines as a whole have the sum's swing: no share of the streams is lost on the way.
    assert abs((flow[1:] + flow[:-1]) / 2 - exact(mixed, grid, middles)).max() < worst


@pytest.mark.parametrize("seed", [4, 9])
def test_arrivals_are_those_in_the_exact_sum(seed: int, tmp_path: Path) -> None:
    scene = stream_scene(seed, tmp_path)
    best = scene.plan().best
    assert best.times[-1] == pytest.approx(scene.arrival(best.path), rel=1e-4)


def test_the_file_s_mean_is_added_unless_the_water_stands_still(mixed: Path) -> None:
    with_mean, without = fetched(season(mixed)), fetched(season(mixed, residual="still"))
    with xr.open_dataset(mixed) as data:
        for name in "uv":
            mean = inside(data[f"{name}_mean"], without)
            apart = getattr(with_mean, name) - getattr(without, name)
            np.testing.assert_allclose(apart, np.broadcast_to(mean, apart.shape), atol=1e-12)
    assert note_of(with_mean, "tidal-streams")["has_mean"]
    sources = [
        current_source(season(mixed, **keys).currents[0]) for keys in ({}, {"residual": "still"})
    ]
    assert len({one.identity(season(mixed)) for one in sources}) == 2


def test_without_amplitudes_the_plan_is_that_of_the_mean(tmp_path: Path) -> None:
    path = written(constants({"M2": 0.0, "K1": 0.0}, mean_m_s=0.5), tmp_path / "pass.nc")
    tide, mean = fetched(season(path)), sea_of_the_mean(path, tmp_path)
    ours, theirs = planned(tide), planned(mean)
    assert ours.best.fuel == pytest.approx(theirs.best.fuel, rel=1e-9)
    np.testing.assert_allclose(ours.best.path, theirs.best.path, atol=1e-3)
    # With no more fields than the file of the mean has, the result is the same bit for bit.
    first, last = tide.u[[0, -1]], tide.v[[0, -1]]
    few = replace(tide, u=first, v=last, times_s=mean.times_s)
    assert planned(few).best.fuel == theirs.best.fuel


def sea_of_the_mean(path: Path, folder: Path) -> CurrentGrid:
    """Return the mean of constants, written as two time steps and read as a changing current."""
    with xr.open_dataset(path) as data:
        u, v = data["u_mean"].values, data["v_mean"].values
    field = type(sea(LON, LAT))(LON, LAT, u, v)
    steps = dataset(field, field, times=("2026-09-09", "2026-09-15"))
    asked = season(path)
    source = CfFiles((str(write(folder / "mean.nc", steps)),))
    return source.current(REGION, asked, Land((), (), 0.0), folder)


def planned(grid: CurrentGrid) -> renew.Plan:
    projection, chart = plane()
    current = planar_current(grid, projection, chart.bounds)
    start, goal = (projection.to_plane(np.array(p)) for p in ((-29.3, 40.5), (-28.2, 41.0)))
    vessel = renew.Vessel(speed=2.0, turn_rate=0.1)
    return renew.plan(chart, current, vessel, start, goal, padding="none", classes=1)


def test_constants_fitted_to_two_months_give_the_streams_of_the_next_autumn(tmp_path: Path) -> None:
    """Both series are UTide's, whose arguments and nodal factors are others."""
    one, other = sea(LON, LAT, 3, 0.5), sea(LON, LAT, 4, 0.5)

    def currents(hours: FloatArray) -> tuple[FloatArray, FloatArray]:
        swing = np.stack([utide_sum(hours), utide_sum(hours, 90.0)])
        u, v = (np.tensordot(swing.T, np.stack([getattr(one, c), getattr(other, c)]), axes=1)
                for c in "uv")  # fmt: skip
        return u, v

    hours = np.arange(24.0 * 60)
    axes = ("time", "lat", "lon")
    data = {c: (axes, w, {"units": "m s-1"}) for c, w in zip("uv", currents(hours), strict=True)}
    times = {"time": ("time", hours, {"units": "hours since 2025-01-01"}), "lat": LAT, "lon": LON}
    hourly = written(xr.Dataset(data, times), tmp_path / "hourly.nc")
    path = written(fit_files([str(hourly)]), tmp_path / "constants.nc")
    grid = fetched(season(path))
    begin = (DEPARTURE - datetime(2025, 1, 1, tzinfo=UTC)).total_seconds()
    u, v = currents((begin + grid.times_s) / 3600)
    x, y = np.searchsorted(LON, grid.lon), np.searchsorted(LAT, grid.lat)
    for ours, theirs in ((grid.u, u), (grid.v, v)):
        truth = theirs[..., y, :][..., x]
        assert np.sqrt(np.mean((ours - truth) ** 2)) <= 0.02 * np.sqrt(np.mean(truth**2))
    assert grid.weak is not None
    assert not grid.weak.any()


# --- the steps ----------------------------------------------------------------------------------


def test_stronger_streams_and_quicker_ones_have_shorter_steps(tmp_path: Path) -> None:
    def step(strengths: dict[str, float]) -> object:
        path = written(constants(strengths), tmp_path / f"{len(strengths)}{strengths}.nc")
        return note_of(fetched(season(path)), "tidal-streams")["step_min"]

    assert step({"M2": 0.05}) == 60
    assert step({"M2": 0.5}) == 30
    assert step({"M2": 3.0}) == 20
    assert step({"M2": 0.5, "M8": 0.3}) == 20


def test_large_regions_have_longer_steps_so_that_the_fields_fit_in_memory(
    mixed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = note_of(fetched(season(mixed)), "tidal-streams")
    grid = fetched(season(mixed))
    monkeypatch.setattr("pipeline.sources.cf.fields._MAX_VALUES", 40 * grid.u[0].size)
    after = note_of(fetched(season(mixed)), "tidal-streams")
    assert (before["step_min"], after["step_min"]) == (30, 60)
    assert after["error_m_s"] == pytest.approx(4 * float(str(before["error_m_s"])))


def test_fields_are_summed_some_at_a_time(mixed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = fetched(season(mixed))
    monkeypatch.setattr(reading, "_CHUNK_VALUES", 3 * LON.size * LAT.size)
    parts = fetched(season(mixed))
    np.testing.assert_allclose(parts.u, whole.u, atol=1e-12)
    np.testing.assert_allclose(parts.v, whole.v, atol=1e-12)


# --- the residual -------------------------------------------------------------------------------


def daily(path: Path, days: int = 6) -> Path:
    """Write daily means that turn from one field to another."""
    one, other = sea(LON, LAT, 5), sea(LON, LAT, 6)
    steps = [type(one)(LON, LAT, one.u + k * other.u, one.v + k * other.v) for k in range(days)]
    return write(path, dataset(*steps, times=[f"2026-09-{9 + k:02}T12:00" for k in range(days)]))


def test_a_residual_of_days_changes_on_the_way(mixed: Path, tmp_path: Path) -> None:
    path = daily(tmp_path / "daily.nc")
    bare = fetched(season(mixed, residual="still"))
    grid = fetched(season(mixed, residual=str(path)))
    one, other = sea(LON, LAT, 5), sea(LON, LAT, 6)
    days = (grid.times_s / 3600 + DEPARTURE.hour + DEPARTURE.minute / 60 - 12) / 24 + 1
    for k in (7, 30, 60):
        wanted = one.u + days[k] * other.u
        found = (grid.u - bare.u)[k]
        x, y = np.searchsorted(LON, grid.lon), np.searchsorted(LAT, grid.lat)
        np.testing.assert_allclose(found, wanted[np.ix_(y, x)], atol=2e-6)
    assert {name for name, _ in grid.files} == {"pass.nc", "daily.nc"}
    assert note_of(grid, "streams-on-residual")["source"] == "A sea made up for a test"
    source = current_source(season(mixed, residual=str(path)).currents[0])
    before = source.identity(season(mixed))
    daily(tmp_path / "daily.nc", days=5)
    assert source.identity(season(mixed)) != before


def test_streams_end_where_their_residual_ends(mixed: Path, tmp_path: Path) -> None:
    grid = fetched(season(mixed, residual=str(daily(tmp_path / "daily.nc", 2))))
    assert grid.times_s[-1] == 3600 * (12 - DEPARTURE.hour) - 60 * DEPARTURE.minute


def test_one_field_is_the_residual_of_the_whole_voyage(mixed: Path, tmp_path: Path) -> None:
    field = sea(LON, LAT, 5)
    path = write(tmp_path / "monthly.nc", dataset(field, times=("2026-09-10T00:00",)))
    grid, bare = (fetched(season(mixed, residual=one)) for one in (str(path), "still"))
    apart = grid.u - bare.u
    np.testing.assert_allclose(apart, np.broadcast_to(apart[0], apart.shape), atol=1e-12)
    assert abs(apart).max() > 0.1


# --- what is refused or noted -------------------------------------------------------------------


def refused(asked: Season) -> str:
    """Return why a season's source is refused, in one line, before it is read or after."""
    source = current_source(asked.currents[0])
    if line := source.uncovered_reason(REGION, asked):
        return line
    with pytest.raises(RequestError) as caught:
        source.current(REGION, asked, Land((), (), 0.0), Path())
    (line,) = caught.value.faults
    return line


def renamed(data: xr.Dataset, *names: str) -> xr.Dataset:
    return data.assign_coords(constituent=list(names))


MESH = {"lat": "node", "lon": "other"}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda one: one.drop_vars(["v_re", "v_im"]), "its harmonic constants lack v_re, v_im;"),
        (lambda one: one.drop_vars("constituent"), "constituent has no names; add the coordinate"),
        (lambda one: renamed(one, "M2", "M2", "K1", "M4", "MF"), "constituent has a name twice"),
        (lambda one: renamed(one, "M2", "S2", "XX9", "M4", "MF"), "'XX9' is no constituent that"),
        (lambda one: one.assign(u_re=one["u_re"].assign_attrs(units="degrees")),
         "u_re is in 'degrees', not in m s-1"),
        (lambda one: one.rename(MESH).drop_vars(list(MESH.values())),
         "nothing says at which longitude and latitude its values are"),
        (lambda one: one.assign(v_im=one["v_im"].isel(constituent=0, drop=True)),
         "v_im has no dimension 'constituent'"),
        (lambda one: one * 30, "speeds reach "),
        (lambda one: one.assign(u_re=one["u_re"].where(one["lon"] > -28.5)),
         "of the region's open water has no data, which is too much to fill"),
        (lambda one: one.isel(lon=slice(0, 12)), "it has no data east of -29.35"),
        (lambda one: one.assign(u_re=one["u_re"].expand_dims(time=2)),
         "u_re has the dimension time (2), which is neither"),
    ],
)  # fmt: skip
def test_faulty_constants_are_refused_with_the_way_out(
    change: Callable[[xr.Dataset], xr.Dataset], message: str, tmp_path: Path
) -> None:
    path = written(change(constants(MIXED)), tmp_path / "bad.nc")
    line = refused(season(path))
    assert message in line
    assert "\n" not in line
    assert "bad.nc" in line


def test_constants_need_a_clock(mixed: Path) -> None:
    asked = Season(name="june", valid="2026-06", currents=(str(mixed),))
    reason = current_source(asked.currents[0]).uncovered_reason(REGION, asked)
    assert reason.startswith("pass.nc: it has harmonic constants, which need a clock: give")
    with pytest.raises(ValueError, match=r"need a clock; add time_method = 'changing', and a 'dep"):
        Season(name="june", valid="2026-06", currents=({"constants": str(mixed)},))


def test_a_path_alone_is_the_constants_with_their_mean(mixed: Path) -> None:
    asked = season(mixed).model_copy(update={"currents": ((str(mixed),),)})
    assert np.array_equal(fetched(asked).u, fetched(season(mixed)).u)


def test_a_residual_may_not_hold_the_tide_or_be_constants(mixed: Path, tmp_path: Path) -> None:
    field = sea(LON, LAT, 5)
    hourly = write(
        tmp_path / "hourly.nc",
        dataset(*[field] * 40, times=[np.datetime64("2026-09-10") + np.timedelta64(k, "h")
                                      for k in range(40)]))  # fmt: skip
    for residual, message in (
        (str(hourly), "residual hourly.nc: its steps are 1 hours apart and show the tide, which"),
        (str(mixed), "residual pass.nc: it has harmonic constants itself; give a current without"),
        (str(daily(tmp_path / "past.nc", 1)), "past.nc: it has one time step, 2026-09-09T12:00Z"),
        (str(tmp_path / "none.nc"), "none.nc does not exist"),
    ):
        asked = season(mixed, residual=residual)
        reason = current_source(asked.currents[0]).uncovered_reason(REGION, asked)
        assert message in reason


def test_currents_that_are_no_constants_are_not_taken_for_them(tmp_path: Path) -> None:
    asked = season(daily(tmp_path / "daily.nc"))
    reason = current_source(asked.currents[0]).uncovered_reason(REGION, asked)
    assert reason.startswith("daily.nc: it has no harmonic constants (u_re, u_im, v_re, v_im); fit")


def test_weak_nodes_are_known_and_old_constants_noted(mixed: Path, tmp_path: Path) -> None:
    grid = fetched(season(mixed))
    assert grid.weak is not None
    assert np.array_equal(grid.weak, np.broadcast_to(grid.lon < -29.0, grid.u[0].shape))
    data = constants(MIXED)
    for end, years in (("2020-09-09T00:00:00+00:00", 6.0), ("2022-01-01", None)):
        data.attrs |= {"time_coverage_start": "2019-01-01T00:00:00", "time_coverage_end": end}
        found = fetched(season(written(data, tmp_path / f"{end[:4]}.nc")))
        told = {one.kind: dict(one.values) for one in found.notes}
        assert told.get("constants-old", {}).get("years") == pytest.approx(years, abs=0.01)
        assert found.weak is None


def test_another_length_of_the_voyage_is_another_artefact(mixed: Path) -> None:
    asked = season(mixed)
    later = asked.model_copy(update={"departure": DEPARTURE + timedelta(hours=1)})
    source = current_source(asked.currents[0])
    assert source.identity(asked) != source.identity(later)
    assert source.issue(asked).last_step is None
