"""The scenario of a one-line request."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pipeline.errors import RequestError
from pipeline.scenario.catalogue import VesselSpec
from pipeline.voyage.request import VoyageRequest
from pipeline.voyage.table import options
from tests.pipeline.synthetic_currents import dataset, sea, write
from tests.pipeline.voyage.waters import scenario_of

_HOURLY = "copernicus-total-hourly"
PALAWAN: dict[str, Any] = {
    "start": "120.30,12.80",
    "goal": "116.80,7.70",
    "vessel": "usv-7m",
    "months": ("2024-07",),
}


def test_a_voyage_is_a_chart_scenario_that_leaves_the_rest_to_be_chosen() -> None:
    scenario, notes = scenario_of(PALAWAN)
    assert (scenario.start, scenario.goal) == ((120.30, 12.80), (116.80, 7.70))
    assert scenario.region is None
    assert scenario.plane is None
    assert scenario.planner.clearance is None
    assert scenario.vessel.name == "usv-7m"
    assert scenario.name == "12n48-120e18-to-7n42-116e48"
    assert scenario.title == "12.80 N 120.30 E to 7.70 N 116.80 E"
    assert notes == ()


def test_each_month_is_a_season_with_the_sources_that_have_it() -> None:
    months = ("2024-07", "2024-12", "2024-05", "2199-01")
    scenario, _ = scenario_of(dict(PALAWAN, months=months))
    assert [season.name for season in scenario.seasons] == list(months)
    assert [season.title for season in scenario.seasons][:2] == ["July 2024", "December 2024"]
    glorys, table = "copernicus-glorys-monthly", "embedded-palawan"
    # No monsoon blows in May, and no reanalysis knows the future.
    assert [season.currents for season in scenario.seasons] == [
        (glorys, table),
        (glorys, table),
        (glorys,),
        ("copernicus-glorys-climatology", table),
    ]


def test_a_table_stands_in_only_where_it_covers_the_place() -> None:
    aegean = dict(PALAWAN, start="23.6E 37.9N", goal="28.3E 36.5N")
    scenario, _ = scenario_of(aegean)
    assert scenario.seasons[0].currents == ("copernicus-glorys-monthly",)


def test_still_water_needs_no_month() -> None:
    asked = dict(PALAWAN, months=(), currents=("still",))
    (season,) = scenario_of(asked)[0].seasons
    assert (season.name, season.currents, season.valid) == ("still", ("still",), "")
    with pytest.raises(RequestError, match="no --month"):
        scenario_of(dict(asked, currents=()))


def test_a_point_on_the_way_in_another_sea_is_refused() -> None:
    with pytest.raises(RequestError, match=r"--via 10\.00 N 140\.00 E lies 2,\d\d\d km from start"):
        scenario_of(dict(PALAWAN, goal="119.9,12.5", via=("140,10",)))
    assert scenario_of(dict(PALAWAN, goal=PALAWAN["start"], via=("140,10",)))[0].via


@pytest.mark.parametrize("option", ["adrift", "within", "endurance"])
def test_an_interval_is_refused_by_the_name_of_its_option(option: str) -> None:
    with pytest.raises(RequestError, match=f"--{option} = '6' is not an interval"):
        scenario_of(dict(PALAWAN, **{option: "6"}))


def test_files_belong_together_and_names_are_of_the_catalogue(tmp_path: Path) -> None:
    field = sea(np.arange(116, 121.1, 0.5), np.arange(7, 13.6, 0.5))
    files = [str(write(tmp_path / name, dataset(field))) for name in ("a.nc", "b.nc")]
    asked = dict(PALAWAN, currents=(files[0], "embedded-palawan", files[1]))
    (season,) = scenario_of(asked)[0].seasons
    assert season.currents == (tuple(files), "embedded-palawan")


def test_a_departure_lets_the_currents_of_a_file_change(tmp_path: Path) -> None:
    lon, lat = np.arange(114.0, 124.0), np.arange(4.0, 16.0)
    hours = np.arange("2026-11-21T18", "2026-11-23T18", dtype="datetime64[h]")
    steps = [sea(lon, lat, 1, 0.1 + 0.01 * k) for k in range(len(hours))]
    file = write(tmp_path / "tide.nc", dataset(*steps, times=hours))
    depart = dict(PALAWAN, months=(), currents=(str(file),))
    asked = dict(depart, depart="2026-11-22T14:30+08:00")
    (season,) = scenario_of(asked)[0].seasons
    assert season.is_changing
    assert season.departure == datetime(2026, 11, 22, 6, 30, tzinfo=UTC)
    assert (season.name, season.valid) == ("2026-11-22t0630z", "")
    assert season.title == "Departure 2026-11-22 06:30 UTC"
    assert season.currents == ((str(file),),)
    window = dict(asked, until="2026-11-23T06:30Z")
    (season,) = scenario_of(window)[0].seasons
    assert season.departures is not None
    assert season.departures.seconds[-1] == 24 * 3600
    assert (season.departures.count, season.to_within) == (25, "30min")
    (season,) = scenario_of(dict(asked, arrive_by="2026-11-23T06:30Z"))[0].seasons
    assert season.arrive_by == datetime(2026, 11, 23, 6, 30, tzinfo=UTC)
    assert season.departure == datetime(2026, 11, 22, 6, 30, tzinfo=UTC)


def test_the_end_of_a_window_is_a_departure_to_choose_from() -> None:
    """A step of half an hour goes from 06:00 to 07:30; the window ends at 07:50."""
    asked = dict(PALAWAN, months=(), currents=(_HOURLY,), depart="2026-11-22T06:00Z")
    (season,) = scenario_of(dict(asked, until="2026-11-22T07:50Z"))[0].seasons
    assert season.departures is not None
    assert season.departures.seconds == (0.0, 1800.0, 3600.0, 5400.0, 6600.0)
    assert season.departures.window == timedelta(minutes=110)
    (even,) = scenario_of(dict(asked, until="2026-11-22T08:00Z"))[0].seasons
    assert even.departures is not None
    assert even.departures.seconds[-1] == 7200.0
    assert even.departures.last is None


@pytest.mark.parametrize("until", ["", "2026-11-22T07:50Z"])
def test_a_departure_in_still_water_needs_no_current(until: str) -> None:
    asked = dict(PALAWAN, months=(), currents=("still",), depart="2026-11-22T06:00Z")
    scenario, notes = scenario_of(dict(asked, until=until))
    (season,) = scenario.seasons
    assert not season.is_changing
    assert season.departure == datetime(2026, 11, 22, 6, tzinfo=UTC)
    assert any("no later departure" in note for note in notes) == bool(until)


@pytest.mark.parametrize("speed", ["", "4..9kn"])
def test_a_departure_alone_takes_the_services_hours_with_tide(speed: str) -> None:
    today = datetime.now(UTC).replace(minute=0, second=0, microsecond=0)
    asked = dict(PALAWAN, months=(), currents=(), depart=today.isoformat(), speed=speed)
    if speed:
        asked = dict(asked, arrive_by=(today + timedelta(days=3)).isoformat())
    (season,) = scenario_of(asked)[0].seasons
    assert season.is_changing
    assert season.currents == ("copernicus-total-hourly",)


TIMES = {"depart": "2026-11-22T06:00Z", "arrive_by": "2026-11-24T06:00Z"}


def test_a_range_of_speeds_is_chosen_from_in_the_currents_of_a_month_or_in_none() -> None:
    asked = dict(PALAWAN, speed="4..9kn", **TIMES)
    for months, currents in ((PALAWAN["months"], ()), ((), ("still",))):
        scenario, _ = scenario_of(dict(asked, months=months, currents=currents))
        assert len(scenario.seasons) == max(1, len(months))
        for season in scenario.seasons:
            assert season.speed is not None
            assert season.speed.least == pytest.approx(4 * 1852 / 3600)
            assert season.speed.most == pytest.approx(9 * 1852 / 3600)
            assert season.departure == datetime(2026, 11, 22, 6, tzinfo=UTC)
            assert season.arrive_by == datetime(2026, 11, 24, 6, tzinfo=UTC)
            assert not season.is_changing
    # Without a vessel by name the figures are those at the highest speed.
    figures = {"vessel": "", "length": "12m", "turning_circle": "40m"}
    by_figures = dict(asked, **figures, months=(), currents=("still",))
    vessel = scenario_of(by_figures)[0].vessel
    assert vessel.speed_m_s == pytest.approx(9 * 1852 / 3600)


def test_speeds_in_a_window_of_departures_have_an_arrival_and_no_proof(tmp_path: Path) -> None:
    hours = np.arange("2026-11-22T00", "2026-11-25T00", dtype="datetime64[h]")
    lon, lat = np.arange(116.0, 121.1, 0.25), np.arange(7.0, 13.6, 0.25)
    file = write(tmp_path / "tide.nc", dataset(*[sea(lon, lat)] * len(hours), times=hours))
    asked = dict(PALAWAN, speed="4..9kn", **TIMES)
    later = datetime.fromisoformat(TIMES["depart"]) + timedelta(hours=6)
    scenario, _ = scenario_of(
        dict(asked, until=later.isoformat(), months=(), currents=(str(file),))
    )
    (season,) = scenario.seasons
    assert season.departures is not None
    assert season.departures.count > 2
    assert season.speed is not None
    assert season.arrive_by == datetime.fromisoformat(TIMES["arrive_by"])
    assert (season.departure, season.to_within) == (None, None)
    assert season.leaves_departure_open


FROM_SIX = dict(PALAWAN, months=(), depart="2026-11-22T06:00Z", currents=(_HOURLY,))
FAULTS_OF_TIMES = [
    ({"depart": "2026-11-22T06:00"}, ["has no zone; add it: 2026-11-22T06:00Z"]),
    ({"depart": "tomorrow"}, ["tomorrow is not a time"]),
    ({"months": ("2026-11",)}, ["--depart and --month both say when"]),
    (
        {"currents": ("still",), "arrive_by": "2026-11-24T05:00Z"},
        ["--arrive-by looks for the latest departure in currents that change"],
    ),
    ({"until": "2026-11-22T05:00Z"}, ["--until 2026-11-22T05:00Z is not after --depart"]),
    (
        {"depart": "", "arrive_by": "2026-11-23T06:00"},
        ["--arrive-by 2026-11-23T06:00 has no zone", "--arrive-by needs --depart"],
    ),
    ({"depart": "soon", "currents": ("still",)}, ["soon is not a time"]),
    (
        {"via": ("119E 11N wait 6h",), "until": "2026-11-23T06:00Z"},
        ["a wait in --via together with --until: the wait leaves a time to choose"],
    ),
    ({"currents": ("still", _HOURLY)}, ["names other currents after 'still'"]),
    (
        {"current_variables": "u,v", "currents": ("still",)},
        ["'current_variables', which are those"],
    ),
    ({"members": "files", "currents": ("still",)}, ["--members are those of files; add"]),
    ({"depart": "", "currents": (), "months": ("2026-13",)}, ["--month 2026-13 is not a month"]),
    (
        {"via": ("119E 11N wait 6h",), "currents": ("still",)},
        ["a wait in --via waits for nothing: give --depart"],
    ),
]
RANGE = dict(PALAWAN, speed="4..9kn", **TIMES)
FAULTS_OF_RANGES = [
    ({"arrive_by": ""}, ["add --arrive-by, or give one speed"]),
    ({"depart": "", "arrive_by": ""}, ["add --depart and --arrive-by, or give one speed"]),
    ({"speed": "9..4kn"}, ["--speed '9..4kn' begins above its end"]),
    ({"speed": "0..4kn"}, ["--speed '0..4kn' begins at a speed of 0"]),
    ({"speed": "4..9"}, ["--speed '4' is not understood"]),
    (
        {"until": "2026-11-23T06:00Z", "arrive_by": "", "speed": "9..4kn"},
        ["begins above its end", "add --arrive-by", "--until looks for the best departure"],
    ),
    ({"until": "2026-11-23T06:00Z"}, ["--until looks for the best departure"]),
    (
        {"members": "0.1m/s", "months": ("2026-11",)},
        ["--members together with --arrive-by and --speed LEAST..MOST: each member has times"],
    ),
]


@pytest.mark.parametrize(
    ("asked", "changes", "words"),
    [*((FROM_SIX, *row) for row in FAULTS_OF_TIMES), *((RANGE, *row) for row in FAULTS_OF_RANGES)],
)
def test_times_and_speeds_that_say_too_little_or_too_much(
    asked: dict[str, object], changes: dict[str, object], words: list[str]
) -> None:
    with pytest.raises(RequestError) as caught:
        scenario_of(dict(asked, **changes))
    assert len(caught.value.faults) == len(words)
    for fault, part in zip(caught.value.faults, words, strict=True):
        assert part in fault


def test_clearance_is_in_true_metres() -> None:
    for text, metres in (("500", 500.0), ("0.5nm", 926.0), ("0", 0.0)):
        scenario, _ = scenario_of(dict(PALAWAN, clearance=text))
        assert scenario.planner.clearance == metres
        assert scenario.scale == 1


def test_a_vessel_may_be_given_as_such() -> None:
    vessel = VesselSpec(length_m=10, speed_m_s=4, turn_rate_deg_s=9)
    assert scenario_of(dict(PALAWAN, vessel=vessel))[0].vessel == vessel
    figures = {"speed": "8kn", "length": "12m", "turning_circle": "40m"}
    assert scenario_of(dict(PALAWAN, vessel="", **figures))[0].vessel.length_m == 12


def test_an_order_is_questioned_only_where_the_other_one_is_water_too() -> None:
    voyage = {"vessel": "usv-7m", "currents": ("still",)}
    # The other way round: the desert of Arabia.
    assert scenario_of(dict(voyage, start="28.9,36.2", goal="28.5,36.3"))[1] == ()
    # The Gulf of Oman, where the Gulf of Finland may be meant.
    notes = scenario_of(dict(voyage, start="59.6,24.6", goal="60.0,24.8"))[1]
    assert len(notes) == 2
    assert "the other way round it would be water, too" in notes[0]


def test_a_bad_name_and_the_same_place_twice_are_refused() -> None:
    asked = dict(PALAWAN, goal="12.8N 120.3E", name="My Voyage")
    with pytest.raises(RequestError, match=r"name = .*lower-case letters"):
        scenario_of(asked)
    with pytest.raises(RequestError, match="start and goal are the same place"):
        scenario_of(dict(asked, name=""))


likely = st.sampled_from(
    ["120.3,12.8", "7.7N 116.8E", "usv-7m", "12kn", "90m", "2024-07", "still", "1e400", "9" * 400]
)
words = likely | st.text(max_size=12)


TEXTS = [one.field for one in options(VoyageRequest) if not one.most and one.kind != "flag"]
LISTS = [one.field for one in options(VoyageRequest) if one.most]


@given(
    st.dictionaries(st.sampled_from(TEXTS), words),
    st.dictionaries(st.sampled_from(LISTS), st.lists(words, max_size=2)),
)
@settings(max_examples=200, deadline=None)
def test_any_words_make_a_scenario_or_are_refused(
    texts: dict[str, str], lists: dict[str, list[str]]
) -> None:
    try:
        scenario, _ = scenario_of({**PALAWAN, **texts, **lists})
    except RequestError:
        return
    assert scenario.region is None


@pytest.mark.parametrize(
    ("text", "members"),
    [
        ("files", {"along": "files"}),
        ("realization", {"along": "realization"}),
        ("0.2m/s", {"spread": 0.2}),
        ("1.8km/h", {"spread": 0.5}),
    ],
)
def test_members_are_files_a_dimension_or_the_speed_of_eddies(
    text: str, members: dict[str, str | float]
) -> None:
    asked = dict(PALAWAN, members=text, currents=("embedded-palawan",))
    if "along" in members:
        with pytest.raises(RequestError, match="needs files"):
            scenario_of(asked)
        return
    (season,) = scenario_of(asked)[0].seasons
    assert season.members is not None
    assert season.members.spread == pytest.approx(members["spread"])


def test_a_speed_of_members_without_a_unit_is_refused() -> None:
    with pytest.raises(RequestError, match=r"--members = '0\.2': .*a speed such as"):
        scenario_of(dict(PALAWAN, members="0.2"))
