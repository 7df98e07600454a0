"""The table of a current against SciPy's interpolation and against the field itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.interpolate import RegularGridInterpolator
from shapely import box

import renew
from renew._types import FloatArray
from renew.inputs.current import TabulatedCurrent
from renew.inputs.tabulation import tabulated
from renew.kernels.current_table import (
    bend_near,
    changes,
    next_slice,
    site_of,
    table_of,
    velocities,
    velocity,
    weakest_and_strongest,
)
from tests.compiler import uncompiled
from tests.strategies import PAPER_VESSEL, SIZE, StreamFunctionCurrent, examples, seeds, single_gyre

BOUNDS = (0.0, 0.0, SIZE, SIZE)


@settings(max_examples=20)
@given(seed=seeds)
def test_lookups_are_bilinear_on_even_and_uneven_nodes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(0.5, 2.0, 7)) if seed % 2 else np.linspace(-3, 4, 7)
    y = np.cumsum(rng.uniform(0.5, 2.0, 5))
    uv = rng.normal(0, 1, (5, 7, 2))
    table = table_of(x, y, uv)
    assert (table.per_x > 0) == (seed % 2 == 0)
    points = rng.uniform((x[0] - 1, y[0] - 1), (x[-1] + 1, y[-1] + 1), (200, 2))
    inside = np.clip(points, (x[0], y[0]), (x[-1], y[-1]))
    expected = RegularGridInterpolator((y, x), uv)(inside[:, ::-1])
    assert velocities(table, points, np.zeros(200)) == pytest.approx(expected, abs=1e-12)
    nodes = np.stack(np.meshgrid(x, y), axis=-1)
    assert velocities(table, nodes.reshape(-1, 2), np.zeros(35)) == pytest.approx(
        uv.reshape(-1, 2), abs=1e-9
    )
    # The same without the compiler.
    assert uncompiled(velocity)(table, points[0, 0], points[0, 1], 0.0) == pytest.approx(
        expected[0], abs=1e-12
    )


@settings(max_examples=20)
@given(seed=seeds)
def test_between_slices_lookups_are_linear_in_time_and_held_outside_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.linspace(0, 4, 5), np.linspace(0, 3, 4)
    times = np.cumsum(rng.uniform(0.5, 2.0, 6)) - 3.0
    uv = rng.normal(0, 1, (6, 4, 5, 2))
    table = table_of(x, y, uv, times=times)
    points, when = rng.uniform((0, 0), (4, 3), (200, 2)), rng.uniform(-5, 8, 200)
    inside = np.clip(when, times[0], times[-1])
    expected = RegularGridInterpolator((times, y, x), uv)(
        np.column_stack([inside, points[:, ::-1]])
    )
    assert velocities(table, points, when) == pytest.approx(expected, abs=1e-12)
    assert uncompiled(velocity)(table, points[0, 0], points[0, 1], when[0]) == pytest.approx(
        expected[0]
    )
    speed = np.linalg.norm(uv, axis=-1)
    least, largest = weakest_and_strongest(table)
    assert least == pytest.approx(speed.min(axis=0))
    assert largest == pytest.approx(speed.max(axis=0))
    change = np.linalg.norm(np.diff(uv, axis=0), axis=-1).max(axis=(1, 2)) / np.diff(times)
    assert changes(table).max() == pytest.approx(change.max())
    # Where the last slice is the first again the table goes on for ever.
    uv[-1] = uv[0]
    period = times[-1] - times[0]
    for turns in (-2, 3):
        again = velocities(table_of(x, y, uv, 0.0, times, period), points, when + turns * period)
        once = velocities(table_of(x, y, uv, 0.0, times, period), points, when)
        assert again == pytest.approx(once, abs=1e-9)


@settings(max_examples=20)
@given(seed=seeds)
def test_around_its_nearest_slice_a_current_is_linear_to_either_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis, times = np.linspace(0, 4, 5), np.cumsum(rng.uniform(0.5, 2.0, 6)) - 3.0
    uv = rng.normal(0, 1, (6, 5, 5, 2))
    uv[-1] = uv[0]
    px, py = rng.uniform(0, 4, 2).tolist()
    lasting, once = (times, uv), (times[:1], uv[:1])
    for slices, period in ((lasting, np.inf), (lasting, float(np.ptp(times))), (once, np.inf)):
        table = table_of(axis, axis, slices[1], 0.0, slices[0], period)
        for time in rng.uniform(-9, 15, 10).tolist():
            bend = bend_near(table, site_of(table, px, py), time)
            assert -bend.before <= time - bend.time <= bend.after
            after, before = (rng.uniform(0, min(one, 50.0)) for one in (bend.after, bend.before))
            for since, u, v in (
                (after, bend.u_after, bend.v_after),
                (-before, bend.u_before, bend.v_before),
            ):
                expected = velocity(table, px, py, bend.time + since)
                assert (bend.u + since * u, bend.v + since * v) == pytest.approx(expected, abs=1e-9)


def test_the_next_slice_is_the_first_behind_a_time() -> None:
    x = np.array([0.0, 1.0])
    times = np.array([10.0, 12.0, 15.0])
    uv = np.zeros((3, 2, 2, 2))
    once, periodic = table_of(x, x, uv, times=times), table_of(x, x, uv, 0.0, times, 5.0)
    assert [next_slice(once, t) for t in (9, 10, 13, 15)] == [10, 12, 15, np.inf]
    assert [next_slice(periodic, t) for t in (9, 10, 13, 15, 16)] == [10, 12, 15, 17, 17]
    assert next_slice(table_of(x, x, uv[:1]), 0.0) == np.inf


def test_slices_of_a_current_that_repeats_itself_come_one_after_another() -> None:
    # Sums of periods and times are rounded: a slice may lie behind itself by that.
    x, period = np.linspace(0.0, 1.0, 3), 20 * np.pi
    times = np.linspace(0.0, period, 65)
    table = table_of(x, x, np.zeros((65, 3, 3, 2)), times=times, period=period)
    now = 0.0
    for _ in range(20 * 64):
        before, now = now, next_slice(table, now)
        assert before < now < before + period / 60


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_a_fine_table_is_as_good_as_its_field(seed: int) -> None:
    field = StreamFunctionCurrent(seed, 0.8)
    table = field.table(BOUNDS)
    assert table.is_fine
    points = np.random.default_rng(seed).uniform(0, SIZE, (5000, 2))
    error = np.linalg.norm(TabulatedCurrent(table)(points) - field(points), axis=1).max()
    assert error <= 2 * table.error
    assert table.strongest == pytest.approx(0.8, rel=0.01)


def test_a_table_is_nearly_the_field_at_its_nodes_and_asks_for_no_point_twice() -> None:
    field, asked = StreamFunctionCurrent(3, 0.8), []

    def counted(points: FloatArray) -> FloatArray:
        asked.append(points.reshape(-1, 2))
        return field(points)

    table = tabulated(counted, (0.0, 0.0, SIZE, SIZE / 3))
    assert len(table.x) > 65, "the scene must need a second table"
    nodes = np.stack(np.meshgrid(table.x, table.y), axis=-1)
    away = np.linalg.norm(table.uv[0] - field(nodes), axis=-1)
    # At nodes where the field was not evaluated, cubics replace it.
    assert away.max() <= 1e-4 * table.strongest
    assert away[::4, ::4].max() < 1e-12
    assert sum(len(points) for points in asked) < len(table.x) ** 2
    points = np.vstack(asked).round(9)
    assert len(np.unique(points, axis=0)) == len(points)


@examples(3, 8)
@given(seed=seeds)
def test_an_eddy_that_few_nodes_meet_counts_in_the_error_of_the_table(seed: int) -> None:
    smooth = StreamFunctionCurrent(seed, 0.5)
    middle = np.random.default_rng(seed).uniform(0.1 * SIZE, 0.9 * SIZE, 2)
    radius = SIZE / 100

    def field(points: FloatArray) -> FloatArray:
        across = (points - middle) / radius
        spin = np.exp(-(across**2).sum(axis=-1, keepdims=True))
        return np.asarray(smooth(points) + spin * across[..., ::-1] * [-1.0, 1.0])

    table = tabulated(field, BOUNDS)
    beside = middle + np.random.default_rng(seed).normal(0, radius, (500, 2))
    error = np.linalg.norm(TabulatedCurrent(table)(beside) - field(beside), axis=1).max()
    assert error <= 2 * table.error


def test_a_field_with_a_step_has_no_fine_table() -> None:
    class Step(renew.CurrentField):
        def __call__(self, points: np.ndarray) -> np.ndarray:
            return np.where(points[..., :1] < 0.3 * SIZE, [0.5, 0.0], [-0.5, 0.0])

    assert not Step().table(BOUNDS).is_fine
    # A plan is still possible, and its fuel is computed in the field itself.
    chart = renew.Chart(box(*BOUNDS), [box(80, 80, 120, 120)])
    route = renew.plan(chart, Step(), PAPER_VESSEL, (10, 10), (190, 190)).best
    assert route.fuel == pytest.approx(renew.fuel(route.path, Step(), PAPER_VESSEL))


def test_the_strongest_current_of_the_gyre_is_its_amplitude() -> None:
    chart, gyre = single_gyre().parts[:2]
    assert gyre.table(chart.bounds).strongest == pytest.approx(gyre.amplitude)
