"""Errors: the places they name, their way between processes, and the strait to blame."""

import math
import pickle

import numpy as np
import pytest

import renew
from renew.errors import InfeasibleError, PlanningError, Strait, Text, from_until, in_metres

PLACES = np.array([1.0, -2.5]), np.array([1e5, 0.1234567])


@pytest.mark.parametrize(
    ("place", "spelled"),
    [
        ((1.0, -2.5), "(1, -2.5) m"),
        ((123456.7891, 0.0004), "(123456.789, 0) m"),
        ((-1e7, 1e-3), "(-10000000, 0.001) m"),
    ],
)
def test_places_are_spelled_in_metres_to_the_millimetre(
    place: tuple[float, float], spelled: str
) -> None:
    assert in_metres(np.array(place)) == spelled


@pytest.mark.parametrize("kind", [renew.StartInNoGoError, renew.UnreachableError, InfeasibleError])
def test_a_message_names_its_places_in_metres_or_as_asked(kind: type[PlanningError]) -> None:
    error = kind("no way from {0} to {1}", *PLACES)
    assert str(error) == "no way from (1, -2.5) m to (100000, 0.123) m"
    assert error.text.spelled(lambda place: f"x={place[0]:g}") == "no way from x=1 to x=100000"


def test_a_message_without_places_may_hold_braces() -> None:
    error = renew.ParameterError("padding = {'a': 1} must be a number")
    assert str(error) == error.text.spelled(str) == "padding = {'a': 1} must be a number"


@pytest.mark.parametrize("kind", [renew.GoalInNoGoError, renew.ParameterError])
def test_an_error_survives_the_way_from_a_worker_process(kind: type[PlanningError]) -> None:
    error = kind("lies at {0}, not at {1}", *PLACES)
    again = pickle.loads(pickle.dumps(error))  # noqa: S301  (our own bytes)
    assert type(again) is kind
    assert str(again) == str(error)
    assert again.text.spelled(repr) == error.text.spelled(repr)


def test_all_errors_can_be_caught_as_one_and_bad_input_as_value_errors() -> None:
    for name in renew.__all__:
        public = getattr(renew, name)
        if isinstance(public, type) and issubclass(public, Exception):
            assert issubclass(public, PlanningError)
    assert issubclass(renew.ParameterError, ValueError)
    assert issubclass(renew.GeometryError, ValueError)


def test_a_blocking_strait_is_named_with_its_width_and_what_the_padding_takes() -> None:
    gap = np.array([[0.0, 3.0], [4.0, 0.0]])
    strait = Strait(gap, 7, 8, -1, 2.5, 3.0)
    assert strait.width == 5
    assert strait.transition == (7, 8, -1)
    error = InfeasibleError.at_strait(strait)
    assert error.strait is strait
    assert str(error) == (
        "blocked at (2, 1.5) m, between (0, 3) m and (4, 0) m: the gap is 5.00 m wide, and "
        "5.50 m are needed, with 2.50 m on the left and 3.00 m on the right bank for padding"
    )
    assert math.isclose(strait.width, np.linalg.norm(gap[1] - gap[0]))


def test_a_message_keeps_its_moments_as_values_and_texts_within_it() -> None:
    inner = Text("shut{0} at {1}", (from_until(0.0, 7200.0), PLACES[0]))
    error = renew.UnreachableError("{0} {{all}}: {1}", Text("classes {1, 2}"), inner)
    assert str(error) == "classes {1, 2} {all}: shut from 0 s until 7200 s at (1, -2.5) m"
    hours = error.text.spelled(lambda _: "here", lambda moment: f"{moment.seconds / 3600:g} h")
    assert hours == "classes {1, 2} {all}: shut from 0 h until 2 h at here"
    assert [place.tolist() for place in error.places] == [PLACES[0].tolist()]
    assert str(from_until(-np.inf, np.inf, on=" on")) == " on"
