"""Heights of the tide: closed forms of single constituents, bounds, spelling, and bad input."""

import datetime as dt
import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st

import renew
from renew.inputs.tide import arguments, speeds
from tests.commands import PYTHON, ran
from tests.strategies import examples

EPOCH = np.datetime64("2026-11-22")
HOUR, DAY = 3600.0, 86400.0
MONTH = np.linspace(0, 30 * DAY, 5001)
NAMES = "M2 S2 N2 K1 M4 O1 M6 MK3 S4 MN4 NU2 S6 MU2 2N2 OO1 LAM2 S1 M1 J1 MM SSA SA MSF MF RHO Q1 T2 R2 2Q1 P1 2SM2 M3 L2 2MK3 K2 M8 MS4".split()  # noqa: E501, SIM905 - NOAA's own order
TIDES = st.builds(
    renew.Tide,
    constants=st.dictionaries(
        st.sampled_from(NAMES),
        st.builds(renew.Constant, st.floats(0, 3), st.floats(0, 360)),
        max_size=6,
    ),
    mean_level=st.floats(-1, 5),
    epoch=st.integers(-40 * 365, 40 * 365).map(lambda days: EPOCH + np.timedelta64(days, "D")),
    ratio=st.floats(0, 2),
    offset=st.floats(-6 * HOUR, 6 * HOUR),
)


def of(constants: dict[str, tuple[float, float]], **other: object) -> renew.Tide:
    """Return a tide about mean level 1.5 m."""
    made = {name: renew.Constant(*one) for name, one in constants.items()}
    return renew.Tide(made, 1.5, EPOCH, **other)  # type: ignore[arg-type]


def test_a_solar_constituent_is_the_cosine_of_the_clock() -> None:
    # S2's argument is twice the hour angle of the mean sun, without nodal factor: 30° an hour.
    wanted = 1.5 + 0.8 * np.cos(np.radians(30 * MONTH / HOUR - 70))
    np.testing.assert_allclose(of({"S2": (0.8, 70.0)}).heights(MONTH), wanted, atol=1e-4)


def test_the_moon_s_constituent_keeps_its_period_and_its_nodal_factor() -> None:
    found = of({"M2": (1.0, 0.0)}).high_and_low(0, 30 * DAY)
    assert list(found.is_high[:2]) in ([True, False], [False, True])
    assert (found.is_high[1:] != found.is_high[:-1]).all()
    # 28.9841042° an hour (Schureman, Table 2); u drifts by less than 0.1° in a month.
    halves = np.diff(found.times)
    np.testing.assert_allclose(halves.mean(), 180 / 28.9841042 * HOUR, rtol=1e-5)
    # f(M2) is 1.037 with the moon's node at 180°, and 0.963 at 0° (Schureman, Table 14).
    high = [
        renew.Tide({"M2": renew.Constant(1.0, 0.0)}, 0.0, np.datetime64(when)).high_and_low(0, DAY)
        for when in ("1997-02-01", "2006-06-01")
    ]
    assert abs(high[0].heights).max() == pytest.approx(1.037, abs=1.5e-3)
    assert abs(high[1].heights).max() == pytest.approx(0.963, abs=1.5e-3)


def test_the_clock_has_its_epoch_ratio_and_offset() -> None:
    tide = of({"M2": (1.0, 20.0), "K1": (0.4, 100.0)})
    later = np.datetime64("2026-12-01T03:00")
    since = float((later - EPOCH) / np.timedelta64(1, "s"))
    moved = renew.Tide(tide.constants, 1.5, later)
    np.testing.assert_allclose(moved.heights(MONTH), tide.heights(MONTH + since), atol=1e-4)
    zone = renew.Tide(tide.constants, 1.5, EPOCH, ratio=0.8, offset=1200.0)
    np.testing.assert_allclose(zone.heights(MONTH), 0.8 * tide.heights(MONTH - 1200), atol=1e-4)
    aware = dt.datetime(2026, 11, 22, 2, tzinfo=dt.timezone(dt.timedelta(hours=2)))
    np.testing.assert_array_equal(
        renew.Tide(tide.constants, 1.5, aware).heights(MONTH), tide.heights(MONTH)
    )


@given(TIDES)
@examples(gate=20, new=300)
def test_heights_stay_between_the_bounds_and_highs_are_the_highest(tide: renew.Tide) -> None:
    heights = tide.heights(MONTH)
    assert tide.lowest - 1e-9 <= heights.min()
    assert heights.max() <= tide.highest + 1e-9
    found = tide.high_and_low(0.0, 30 * DAY)
    np.testing.assert_allclose(found.heights, tide.heights(found.times), atol=1e-3)
    ends = tide.heights(np.array([0.0, 30 * DAY]))
    assert heights.max() <= max(*ends, *found.heights, -math.inf) + 1e-9
    assert heights.min() >= min(*ends, *found.heights, math.inf) - 1e-9
    # Between a high and the low after it the tide only falls.
    for (begin, end), falls in zip(
        itertools.pairwise(found.times[:12]), found.is_high[:12], strict=False
    ):
        between = np.diff(tide.heights(np.linspace(begin, end, 50)))
        assert ((between <= 1e-3) if falls else (between >= -1e-3)).all()


@given(TIDES, st.lists(st.floats(-400 * DAY, 400 * DAY), min_size=1, max_size=20))
@examples(gate=20, new=300)
def test_heights_are_the_sum_by_the_library_s_arguments(
    tide: renew.Tide, times: list[float]
) -> None:
    at = np.array(times)
    instants = np.asarray(tide.epoch + np.rint(1e6 * (at - tide.offset)).astype("m8[us]"))
    factors, angles = arguments(tide.constants, instants)
    figures = np.array([*tide.constants.values()]).reshape(-1, 2)
    terms = figures[:, :1] * factors * np.cos(angles - np.radians(figures[:, 1:]))
    wanted = tide.ratio * (tide.mean_level + terms.sum(axis=0))
    np.testing.assert_allclose(tide.heights(at), wanted, atol=1e-3)


def test_a_tide_without_amplitude_is_its_mean_level_exactly() -> None:
    for constants in ({}, {"M2": renew.Constant(0.0, 30.0)}):
        tide = renew.Tide(constants, 1.7, EPOCH)
        assert (tide.heights(MONTH) == 1.7).all()
        assert (tide.lowest, tide.highest) == (1.7, 1.7)
        assert tide.high_and_low(0.0, 9 * DAY).times.size == 0


def test_constituents_have_schureman_s_speeds_and_any_case() -> None:
    # Schureman, Table 2, degrees an hour.
    table = {"M2": 28.9841042, "k1": 15.0410686, "Mf": 1.0980331, "LAM2": 29.4556253,
             "RHO": 13.4715145, "2MK3": 42.9271398, "M3": 43.4761563, "Sa": 0.0410686}  # fmt: skip
    np.testing.assert_allclose(speeds(table), [*table.values()], atol=1e-6)
    np.testing.assert_array_equal(
        of({"lam2": (1.0, 9.0)}).heights(MONTH), of({"Lambda2": (1.0, 9.0)}).heights(MONTH)
    )


def test_a_tide_is_pickled_without_what_it_predicted() -> None:
    tide = of({"M2": (1.0, 20.0)}, name="Boston", datum="MLLW", ratio=0.9, offset=60.0)
    small = len(pickle.dumps(tide))
    heights = tide.heights(MONTH)
    again = pickle.loads(pickle.dumps(tide))  # noqa: S301  (our own bytes)
    assert len(pickle.dumps(tide)) == small
    np.testing.assert_array_equal(again.heights(MONTH), heights)
    assert (again.name, again.datum) == ("Boston", "MLLW")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"constants": None}, "tide: constants = None must be a mapping"),
        (
            {"constants": {"M2": (-1, 3), "XX2": (1, 2), "RHO": (1, 2), "Rho1": (1, 2)}},
            (
                "tide: M2 = (-1, 3) must be an amplitude (m) not below 0, and a phase (degrees); "
                "'XX2' is no constituent that pyfes knows; leave it out if it is small; "
                "RHO1 is given 2 times"
            ),
        ),
        (
            {"mean_level": "2 m", "ratio": -1, "offset": math.nan, "name": "Hull"},
            (
                "tide of Hull: mean_level = '2 m' must be a number from -1000 to 1000; ratio = -1 "
                "must be a number from 0 to 1000; offset = nan must be a number from -86400 to "
                "86400"
            ),
        ),
        ({"epoch": "now"}, "tide: epoch = 'now' must be a datetime or a datetime64"),
    ],
)
def test_what_is_wrong_is_named_at_once(change: dict[str, object], message: str) -> None:
    right = {"constants": {}, "mean_level": 0.0, "epoch": EPOCH}
    with pytest.raises(renew.ParameterError) as caught:
        renew.Tide(**(right | change))  # type: ignore[arg-type]
    assert str(caught.value) == message


def test_times_must_be_numbers_within_centuries() -> None:
    for times in ([math.inf], ["noon"], [1e12], [math.nan]):
        with pytest.raises(renew.ParameterError, match="tide: times"):
            of({"S2": (1.0, 0.0)}).heights(times)  # type: ignore[arg-type]


def test_without_pyfes_only_a_tide_with_constants_asks_for_it() -> None:
    script = """
import sys
sys.modules["pyfes"] = None
import numpy as np, renew
from renew.inputs.tide import speeds
epoch = np.datetime64("2026-11-22")
print(renew.Tide({}, 1.5, epoch).heights(np.zeros(1)))
for asked in (lambda: renew.Tide({"M2": (1.0, 0.0)}, 1.5, epoch), lambda: speeds(["M2"])):
    try:
        asked()
    except renew.ParameterError as error:
        print(error)
"""
    done = ran(*PYTHON, script)
    heights, *refused = done.splitlines()
    assert heights == "[1.5]"
    assert len(refused) == 2
    for line in refused:
        assert line.endswith("pyfes, which is not installed; pip install 'pyfes<2026.10'")
