"""Current fields against independent interpolation, differences and samples."""

import math

import numpy as np
import pytest
from hypothesis import given
from scipy.interpolate import RegularGridInterpolator
from shapely import box

import renew
from renew._types import FloatArray
from tests.strategies import PAPER_VESSEL, StreamFunctionCurrent, seeds, single_gyre


@given(seed=seeds)
def test_gridded_current_is_bilinear(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = np.cumsum(rng.uniform(0.1, 5, 6)), np.cumsum(rng.uniform(0.1, 5, 4))
    u, v = rng.normal(size=(2, 4, 6))
    current = renew.GriddedCurrent(x, y, u, v)
    points = np.column_stack([rng.uniform(x[0], x[-1], 50), rng.uniform(y[0], y[-1], 50)])
    for component, values in enumerate((u, v)):
        oracle = RegularGridInterpolator((y, x), values)(points[:, ::-1])
        assert current(points)[:, component] == pytest.approx(oracle, abs=1e-12)
    assert current.table((0, 0, 1, 1)).strongest >= np.linalg.norm(current(points), axis=1).max()
    beyond = np.array([[x[-1] + 7, y[0] - 9]])
    assert current(beyond)[0] == pytest.approx([u[0, -1], v[0, -1]])


@pytest.mark.parametrize(
    ("axes", "shape", "message"),
    [
        (([0, 1, 1], [0, 1]), (2, 3), "not ascending"),
        (([0.0], [0, 1]), (2, 1), "< 2 nodes"),
        (([0, 1, 2], [0, 1]), (3, 2), r"not \(2, 3\)"),
    ],
)
def test_gridded_current_refuses_bad_grids(
    axes: tuple[list[float], list[float]], shape: tuple[int, int], message: str
) -> None:
    x, y = (np.array(axis, dtype=float) for axis in axes)
    with pytest.raises(renew.ParameterError, match=message):
        renew.GriddedCurrent(x, y, np.zeros(shape), np.zeros(shape))


def test_currents_whose_squares_overflow_are_refused() -> None:
    with pytest.raises(renew.ParameterError, match=r"amplitude = 1e\+300 must be"):
        renew.GyreCurrent(1e300, 100, 100)
    huge = np.full((2, 2), 1e200)
    with pytest.raises(renew.ParameterError, match="4 nodes not finite, or beyond"):
        renew.GriddedCurrent([0.0, 1.0], [0.0, 1.0], huge, huge)  # type: ignore[arg-type]


def test_gyre_is_free_of_divergence_and_peaks_at_its_amplitude() -> None:
    gyre = renew.GyreCurrent(0.8, 100, 60, columns=2, rows=2)
    points = np.random.default_rng(0).uniform([0, 0], [100, 60], (200, 2))
    step = 1e-4
    dx, dy = np.array([step, 0]), np.array([0, step])
    du = (gyre(points + dx) - gyre(points - dx))[:, 0] / (2 * step) / (2 / 100)
    dv = (gyre(points + dy) - gyre(points - dy))[:, 1] / (2 * step) / (2 / 60)
    assert du + dv == pytest.approx(0, abs=1e-6)
    fine = np.stack(np.meshgrid(np.linspace(0, 100, 401), np.linspace(0, 60, 401)), axis=-1)
    assert np.linalg.norm(gyre(fine), axis=-1).max() == pytest.approx(0.8, rel=1e-4)


def test_statistics_of_a_triangle_match_a_large_sample() -> None:
    current = StreamFunctionCurrent(5, 0.8)
    triangle = np.array([[20.0, 30.0], [60.0, 40.0], [30.0, 80.0]])
    found = current.statistics(triangle[None])
    weights = np.random.default_rng(1).dirichlet([1, 1, 1], 50_000)
    sample = current(weights @ triangle)
    speed = np.linalg.norm(sample, axis=1)
    mean = sample.mean(axis=0)
    assert found.speed[0] == pytest.approx(speed.mean(), rel=0.05)
    assert found.speed_std[0] == pytest.approx(speed.std(), rel=0.25)
    assert found.direction[0] == pytest.approx(math.atan2(mean[1], mean[0]), abs=0.05)


def test_a_callable_is_checked() -> None:
    path = np.array([[0.0, 0.0], [10.0, 0.0]])
    with pytest.raises(renew.ParameterError, match="own shape"):
        renew.fuel(path, lambda points: np.zeros(len(points)), PAPER_VESSEL)
    with pytest.raises(renew.ParameterError, match="not finite"):
        renew.fuel(path, lambda points: np.full(points.shape, np.nan), PAPER_VESSEL)
    still = renew.fuel(path, np.zeros_like, PAPER_VESSEL)
    assert still == pytest.approx(10)


def _polite(points: FloatArray) -> FloatArray:
    """Return the published single gyre's current."""
    return single_gyre().current(points)


def _scribbling(points: FloatArray) -> FloatArray:
    """Return it in the array of the points."""
    points[...] = _polite(points)
    return points


class _Reusing:
    """Returns it in buffers that are overwritten by the next call."""

    def __init__(self) -> None:
        self._buffers: list[FloatArray] = []

    def __call__(self, points: FloatArray) -> FloatArray:
        """Spoil what was returned before."""
        for buffer in self._buffers:
            buffer[...] = 7.0
        self._buffers.append(_polite(points))
        return self._buffers[-1]


class _OwnField(renew.CurrentField):
    """A field of the user's own that does both."""

    def __init__(self) -> None:
        self._reusing = _Reusing()

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return a buffer, and write into the points."""
        velocity = self._reusing(points)
        points[...] = 0.0
        return velocity


def _routes(current: object) -> list[tuple[object, ...]]:
    """Return what a plan in a current finds, exactly."""
    plan = renew.plan(
        single_gyre().chart,
        current,  # type: ignore[arg-type]
        PAPER_VESSEL,
        np.array([10.0, 10.0]),
        np.array([90.0, 90.0]),
        classes=4,
    )
    return [(one.homotopy, one.fuel, one.clearance, one.path.tobytes()) for one in plan.routes]


_TIMES = [0.0, 1000.0]


@pytest.mark.gate_share(2)
@pytest.mark.parametrize(
    ("rude", "well_behaved"),
    [
        (_scribbling, _polite),
        (_Reusing(), _polite),
        (_OwnField(), _polite),
        (
            renew.VaryingCurrent(_TIMES, [_scribbling, _Reusing()]),
            renew.VaryingCurrent(_TIMES, [_polite, _polite]),
        ),
        (
            renew.VaryingCurrent(_TIMES, lambda points, times: _scribbling(points) + _zero(times)),
            renew.VaryingCurrent(_TIMES, lambda points, _: _polite(points)),
        ),
    ],
    ids=["writes", "reuses", "own field", "slices", "function of time"],
)
def test_a_function_may_write_into_what_it_gets_and_gave(
    rude: object, well_behaved: object
) -> None:
    assert _routes(rude) == _routes(well_behaved)


def _zero(times: FloatArray) -> float:
    """Spoil the times."""
    if times.shape:
        times[...] = 0.0
    return 0.0


def test_members_may_write_into_what_they_get() -> None:
    def planned(*members: object) -> renew.EnsemblePlan:
        chart, ends = renew.Chart(box(0, 0, 60, 60), [box(25, 20, 35, 40)]), ((10, 10), (50, 50))
        return renew.plan_ensemble(chart, members, PAPER_VESSEL, *ends, classes=1)  # type: ignore[arg-type]

    weak = renew.UniformCurrent(0.1, 0.0)
    rude, polite = planned(_scribbling, weak), planned(_polite, weak)
    assert rude.best.path.tobytes() == polite.best.path.tobytes()
    assert rude.best.clearance == polite.best.clearance
