"""The scenario's models agree with the planner, and describe each of their keys."""

import dataclasses
import tomllib
from datetime import timedelta
from pathlib import Path
from types import ModuleType

import pytest
from pydantic import BaseModel, ValidationError

import renew
from pipeline.errors import RequestError
from pipeline.model import plan_options, planner_vessel
from pipeline.nightly import config
from pipeline.scenario import catalogue, model as scenario_model, region, season
from pipeline.scenario.catalogue import VesselSpec
from pipeline.scenario.loading import parse_scenario
from pipeline.scenario.model import PlannerOptions, Scenario
from pipeline.scenario.season import Season
from pipeline.scenario.strict import descriptions, remedy_of
from pipeline.sources import tide_stations
from renew.inputs.options import RANGES
from tests.reference import tables

VERBS = ("add", "give", "leave", "list", "name", "use", "write")
UNITS = {"_deg_s": "degrees/s", "_m_s": "m/s", "_m": "metres"}


def keys() -> list[tuple[str, str]]:
    """Return the path of every key of a scenario, with its description."""

    def of(model: type[BaseModel], path: str) -> list[tuple[str, str]]:
        known = descriptions(model)
        return [
            (f"{path}.{name}".strip("."), known.get(field.alias or name, ""))
            for name, field in model.model_fields.items()
        ]

    return [key for table in tables() for key in of(table.model, table.path)]


@pytest.mark.parametrize("module", [scenario_model, config, tide_stations])
def test_what_is_said_of_keys_is_of_keys_that_there_are(module: ModuleType) -> None:
    models = {**vars(catalogue), **vars(region), **vars(season), **vars(module)}
    file = Path(str(module.__file__)).with_name("keys.toml")
    for name, texts in tomllib.loads(file.read_text("utf-8")).items():
        fields = models[name].model_fields
        assert {*texts} <= {field.alias or key for key, field in fields.items()}, name


def test_the_planners_options_are_those_of_plan_with_its_defaults() -> None:
    taken = dataclasses.asdict(renew.PlanOptions())
    options = {name: field.default for name, field in PlannerOptions.model_fields.items()}
    # A clearance that is left out is chosen for the vessel and the chart.
    assert options.pop("clearance") is None
    assert taken.pop("clearance") == 0.0
    # By default a scenario's classes are choices; the paper's are all classes.
    assert options.pop("distinct_by") == "auto"
    assert taken.pop("distinct_by") == 0.0
    # Of an hour in all scenarios.
    assert taken.pop("min_lateness") == 0.0
    assert plan_options(PlannerOptions(adrift="6h"), 10.0).adrift == 2_160.0
    # It moves a scenario's stops before there is a plan.
    assert options.pop("snap") == 0.0
    # It is kept between plans.
    assert options.pop("lanes") is None
    assert options == taken
    assert {name: type(value) for name, value in options.items()} == {
        name: type(value) for name, value in taken.items()
    }
    assert plan_options(PlannerOptions(padding=3.0), min_lateness=60.0) == renew.PlanOptions(
        padding=3.0, distinct_by="auto", min_lateness=60.0
    )


def asked(**changes: object) -> dict[str, object]:
    """Return a voyage of a degree in lon/lat, as TOML has it, with other keys."""
    return {
        "schema_version": 1,
        "name": "calm",
        "region": {"bbox": [119.0, 9.0, 120.2, 10.0]},
        "vessel": {"length_m": 2.0, "speed_m_s": 4.0, "turn_rate_deg_s": 35.0, "draught_m": 1.0},
        "start": [119.1, 9.5],
        "goal": [120.1, 9.5],
        **changes,
    }


WINDOW = {"first": "2026-11-22T06:00:00Z", "every": "1h", "count": 24}
CHANGING = {
    "name": "tide",
    "time_method": "changing",
    "departure": "2026-11-22T06:00:00Z",
    "currents": ["./tide.nc"],
}


STEADY_SPEED = {
    "name": "calm",
    "currents": ["still"],
    "departure": "2026-11-22T06:00:00Z",
    "arrive_by": "2026-11-23T06:00:00Z",
    "speed": {"least": 2.0, "most": 6.0},
}


@pytest.mark.parametrize("base", [STEADY_SPEED, {**STEADY_SPEED, **CHANGING}])
def test_speeds_are_chosen_in_steady_and_in_changing_currents(base: dict[str, object]) -> None:
    season = Season.model_validate(base)
    assert season.speed is not None
    assert (season.speed.least, season.speed.most) == (2.0, 6.0)
    assert not season.leaves_departure_open


FAULTS_OF_TIMES = [
    ({"departure": None}, "lacks 'departure'"),
    ({"departure": "2026-11-22T06:00:00"}, "timezone"),
    ({"valid": "2026-11"}, "has 'valid'"),
    ({"departure": None, "valid": "2026-11"}, "'departure'; add.*has 'valid'"),
    ({"max_hours": 0}, "max_hours"),
    ({"departures": WINDOW}, "both 'departure' and 'departures'"),
    ({"departure": None, "departures": {**WINDOW, "every": "0h"}}, "no time at all"),
    ({"departure": None, "departures": {**WINDOW, "every": "often"}}, "not an interval"),
    ({"departure": None, "departures": {**WINDOW, "count": 10_001}}, "equal to 10000"),
    (
        {"departure": None, "departures": {**WINDOW, "every": "1d", "count": 400}},
        "over 9,576 hours; 8,784 are the most",
    ),
    ({"departure": None, "departures": {**WINDOW, "first": "2026-11-22T06:00"}}, "timezone"),
    ({"to_within": "1h"}, "'to_within', but no 'departures'"),
    ({"to_within": "soon"}, "not an interval"),
    (
        {"to_within": "1h", "arrive_by": "2026-11-22T06:00:00Z"},
        "no 'departures' .*is to arrive_by 2026-11-22T06:00:00.00:00, not after its departure",
    ),
    ({"arrive_by": "2028-11-22T06:00:00Z"}, "under way for more than 8,784 hours"),
]
FAULTS_OF_SPEEDS = [
    ({"speed": {"least": 6.0, "most": 2.0}}, "speed.least = 6 m/s above speed.most = 2 m/s"),
    ({"arrive_by": None}, "no 'arrive_by'"),
    ({"departure": None}, "no 'departure'"),
    ({"speed": {"least": float("nan"), "most": 2.0}}, "speed.least\n.*finite"),
    ({"speed": {"least": 0.0, "most": 2e6}}, "speed.least\n(.*\n)*speed.most"),
    ({"speed": {"least": 1.0}}, "speed.most\n.*required"),
    ({"arrive_by": "2026-11-22T05:00:00Z"}, "not after its departure"),
    (
        {"speed": {"least": 6.0, "most": 2.0}, "departure": None, "arrive_by": None},
        "exchange them; it has 'speed', but no 'departure'.*; it has 'speed', but no 'arrive_",
    ),
    (
        {"speed": {"least": 6.0, "most": 2.0}, "currents": ["copernicus-glorys-monthly"]},
        "exchange them; it lacks 'valid'",
    ),
]


@pytest.mark.parametrize(
    ("base", "changes", "words"),
    [
        *((CHANGING, *row) for row in FAULTS_OF_TIMES),
        *((STEADY_SPEED, *row) for row in FAULTS_OF_SPEEDS),
    ],
)
def test_times_and_speeds_of_a_season_that_contradict_each_other_are_refused(
    base: dict[str, object], changes: dict[str, object], words: str
) -> None:
    Season.model_validate(base)
    with pytest.raises(ValidationError, match=words):
        Season.model_validate({**base, **changes})


def test_a_choice_of_speeds_is_of_its_season_and_at_true_scale() -> None:
    two = asked(seasons=[STEADY_SPEED, {"name": "other", "currents": ["still"]}])
    scenario = parse_scenario(two)
    speeds = [scenario.vessel_in(season).speed_m_s for season in scenario.seasons]
    assert speeds == [6.0, 4.0]
    assert scenario.fastest_vessel.speed_m_s == 6.0
    with pytest.raises(RequestError, match="a scale other than 1 together with 'speed'"):
        parse_scenario({**two, "scale": 100.0})


def test_currents_are_needed_until_the_last_departure_and_the_arrival() -> None:
    window = {"departure": None, "departures": WINDOW, "to_within": "1h", "max_hours": 10}
    found = Season.model_validate({**CHANGING, **window}).period
    assert f"{found.begin}, {found.end}" == "2026-11-22 06:00:00+00:00, 2026-11-23 15:00:00+00:00"
    by = Season.model_validate({**CHANGING, "arrive_by": "2026-11-24T06:00:00Z", "max_hours": 1})
    assert f"{by.period.end}" == "2026-11-24 06:00:00+00:00"
    chosen = by.departing(found.begin, "summer")
    assert Season.model_validate(chosen.model_dump()) == chosen
    assert (chosen.departure, chosen.arrive_by) == (found.begin, None)


def test_changing_currents_are_planned_at_true_scale() -> None:
    tide = asked(seasons=[CHANGING])
    begin, end = parse_scenario(tide).passage("tide", 5400.0) or (None, None)
    assert f"{begin}, {end}" == "2026-11-22 06:00:00+00:00, 2026-11-22 07:30:00+00:00"
    with pytest.raises(RequestError, match=r"a scale other than 1 .* the tide would change"):
        parse_scenario({**tide, "scale": 1000.0})


def test_the_planners_ranges_are_those_of_plan() -> None:
    for name, field in PlannerOptions.model_fields.items():
        if name in {
            "adrift",
            "clearance",
            "lanes",
            "snap",
        }:  # a type's range, beside None; no option of plan()
            continue
        limits = {
            key: getattr(one, key)
            for one in field.metadata
            for key in ("ge", "gt", "le", "lt")
            if getattr(one, key, None) is not None
        }
        assert limits == RANGES.get(name, {}), name


def test_the_vessels_limits_are_accepted_by_the_planner() -> None:
    schema = VesselSpec.model_json_schema()["properties"]
    keys = ("length_m", "speed_m_s", "fuel_coefficient", "fuel_exponent")
    largest = {key: float(schema[key]["maximum"]) for key in keys} | {"turn_rate_deg_s": 1.0}
    assert planner_vessel(VesselSpec.model_validate(largest)).length == largest["length_m"]
    for key in keys:
        with pytest.raises(ValidationError):
            VesselSpec.model_validate(largest | {key: largest[key] * 1.1})


@pytest.mark.parametrize(("path", "description"), keys(), ids=[path for path, _ in keys()])
def test_a_keys_description_says_meaning_unit_and_remedy(path: str, description: str) -> None:
    meaning, _, remedy = description.removesuffix(".").rpartition(". ")
    assert meaning, "a sentence on the meaning comes before the remedy"
    assert description.endswith(".")
    assert remedy.lower().startswith(VERBS), remedy
    assert remedy_of(description) == remedy[0].lower() + remedy[1:]
    for suffix, unit in UNITS.items():
        if path.endswith(suffix):
            assert unit in meaning
            break


def test_every_table_is_described() -> None:
    paths = {table.path for table in tables()}
    assert {"", "region", "chart", "chart.source", "vessel", "seasons", "planner"} <= paths
    assert all(table.model.__doc__ for table in tables())
    assert tables()[0].model is Scenario


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"departures": WINDOW}, "'departures', which needs currents that change, a .tide."),
        (
            {"departures": WINDOW, "to_within": "1h"},
            "'departures' and 'to_within', which need currents",
        ),
        (
            {"departure": "2026-11-22T06:00Z", "arrive_by": "2026-11-23T06:00Z"},
            "'arrive_by', which needs currents .* or give speeds to choose from",
        ),
    ],
)
def test_departures_are_chosen_where_something_changes_with_time(
    changes: dict[str, object], words: str
) -> None:
    calm = asked(seasons=[{"name": "calm", "currents": ["still"], **changes}])
    with pytest.raises(RequestError, match=words):
        parse_scenario(calm)
    parse_scenario({**calm, "tide": {"stations": ["boston"]}})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"tide": None},
            r"season 'calm' has nothing to wait for at via\[1\].wait: .* or leave the wait out",
        ),
        ({"seasons": [{"name": "calm", "currents": ["still"]}]}, "nothing to wait for"),
        (
            {"seasons": [{"name": "calm", "currents": ["still"], "departures": WINDOW}]},
            r"has a wait at an anchorage together with 'departures': .*; give .* one 'departure'",
        ),
        (
            {"via": [{"at": [119.3, 9.5], "wait": "2h"}, {"at": [119.5, 9.5], "wait": "6h"}]},
            r"via\[0\].wait and via\[1\].wait; a plan waits at one anchorage: leave out",
        ),
        ({"via": [{"at": [119.5, 9.5], "wait": "5d"}]}, "'5d' is longer than 3 days; give at most"),
        ({"via": [{"at": [119.5, 9.5], "wait": "soon"}]}, "'soon' is not an interval"),
        ({"via": [{"at": [119.5, 9.5], "wait": "-2h"}]}, "'-2h' is not an interval"),
        ({"via": [{"at": [119.5, 9.5]}]}, r"via\[0\].wait is missing; give"),
    ],
)
def test_a_wait_at_an_anchorage_needs_a_clock_and_one_departure(
    changes: dict[str, object], words: str
) -> None:
    waits = asked(
        via=[[119.3, 9.5], {"at": [119.5, 9.5], "wait": "6h"}],
        tide={"stations": ["boston"]},
        seasons=[{"name": "calm", "currents": ["still"], "departure": "2026-11-22T06:00Z"}],
    )
    scenario = parse_scenario(waits)
    assert scenario.anchorage == (1, timedelta(hours=6))
    assert scenario.stops["via[1]"] == (119.5, 9.5)
    with pytest.raises(RequestError, match=words):
        parse_scenario({**waits, **changes})
