"""Sentences on why a route was chosen and how sure that is, and the order in which they compare."""

import math
from dataclasses import replace

from pipeline.findings.sentences import CaseFacts
from pipeline.findings.text import gap_figure
from pipeline.model import Energy, Passage, RouteMetrics

BEST = RouteMetrics(
    rank=1,
    homotopy="e",
    fuel=900.0,
    fuel_per_distance=0.9,
    length=1000.0,
    length_m=1_000_000.0,
    clearance_m=3_460.0,
    duration_s=1_000_000 / 1.25,
    speed_m_s=1.0,
    still_fuel=1000.0,
    optimality_gap=0.25,
    trials=1430,
    collisions=0,
    land_m=0.0,
    passages=(Passage("west", ("1",)), Passage("between", ("2", "3"))),
)
TWIN = replace(BEST, rank=2, fuel=910.0)
OTHER = replace(
    BEST,
    rank=3,
    fuel=1000.0,
    length_m=960_000.0,
    duration_s=960_000 / 0.9,
    passages=(Passage("east", ("1",)),),
)


def test_the_best_route_is_compared_with_the_best_by_another_passage() -> None:
    assert CaseFacts([BEST, TWIN, OTHER]).rival is OTHER
    text = " ".join(CaseFacts([BEST, TWIN, OTHER]).verdict())
    assert "The way west of island 1 is the one to take. 40.0 km longer than east, but" in text
    assert "but the current adds 0.25 m/s (takes 0.10 m/s there)." in text
    assert "The best way east of island 1 needs 11.1 % more fuel." in text
    assert "1 class is shorter" in text
    assert "saves 40.00 km and needs 11.1 % more fuel" in text
    assert "keeps at least 3.46 km from land; none of 1,430 simulated hard-over turns met" in text
    # A gap of a quarter of the bound: 720, a fifth below the fuel.
    assert "no route within the chart, of any class and however close to" in text
    assert "needs less than 72.00 % of still water; this one is within 25.0 % of that bound" in text


def test_each_other_route_is_told_why_it_needs_more() -> None:
    facts = CaseFacts([BEST, TWIN, OTHER])
    assert facts.why_dearer(BEST) == ""
    assert facts.why_dearer(OTHER) == (
        "40.0 km shorter than the best route, but the current takes 0.10 m/s (adds 0.25 m/s there)."
    )
    assert facts.why_dearer(TWIN).startswith("As long as the best route, and the current adds")
    longer = replace(OTHER, length_m=1_100_000.0, duration_s=1_100_000.0)
    assert facts.why_dearer(longer) == (
        "100 km longer than the best route, and the current adds nothing (adds 0.25 m/s there)."
    )
    still = CaseFacts([BEST, longer], lacks_current=True)
    assert still.why_dearer(longer) == "100 km longer than the best route."


def test_without_another_passage_it_is_compared_with_the_next_best() -> None:
    assert CaseFacts([BEST, TWIN]).rival is TWIN
    first, reason, lead, *_ = CaseFacts([BEST, TWIN]).verdict()
    assert first == "The best route is the one to take."
    assert reason == "As long as the next, and the current adds 0.25 m/s on both."
    assert lead == "The next best route needs 1.1 % more fuel."


def test_a_route_chosen_by_its_class_is_not_called_cheaper() -> None:
    facts = CaseFacts([replace(BEST, fuel=1100.0), OTHER])
    assert facts.because() == (
        "Route 3 needs 9.1 % less fuel, but its class needs more in the mean."
    )
    assert facts.lead() == ""


def test_the_only_class_and_its_collisions_are_stated() -> None:
    alone = replace(BEST, collisions=7, clearance_m=math.inf, optimality_gap=math.nan)
    assert CaseFacts([alone]).rival is None
    text = " ".join(CaseFacts([alone]).verdict())
    assert "No other class that was planned has a route." in text
    assert "no land to keep clear of; 7 of 1,430 simulated hard-over turns met land" in text
    assert "saved" not in text


def test_where_there_is_no_land_no_turn_is_reported_to_have_missed_it() -> None:
    alone = replace(BEST, collisions=0, clearance_m=math.inf)
    text = " ".join(CaseFacts([alone]).verdict())
    assert "The chart has no land to keep clear of." in text
    assert "turns" not in text


def test_the_reason_is_length_or_the_current() -> None:
    longer = CaseFacts([BEST, OTHER]).because()
    assert longer == (
        "40.0 km longer than east, but the current adds 0.25 m/s (takes 0.10 m/s there)."
    )
    shorter = replace(OTHER, length_m=1_200_000.0, duration_s=1_200_000 / 1.3)
    assert CaseFacts([BEST, shorter]).because() == (
        "200 km shorter than east, although the current adds 0.25 m/s (0.30 there)."
    )
    assert CaseFacts([BEST]).because() == "No other class that was planned has a route."
    alike = replace(shorter, duration_s=1_200_000 / 1.25)
    assert CaseFacts([BEST, alike]).because() == (
        "200 km shorter than east, and the current adds 0.25 m/s on both."
    )
    unhelped = replace(BEST, speed_m_s=1.251)
    assert "the current adds nothing (takes" in CaseFacts([unhelped, OTHER]).because()


def test_the_gain_from_the_current_is_relative_to_each_routes_own_speed() -> None:
    """Time gained by a higher speed through the water is not credited to the current."""
    faster = replace(OTHER, speed_m_s=1.251, duration_s=OTHER.length_m / 1.25)
    said = CaseFacts([replace(BEST, speed_m_s=0.75), faster]).because()
    assert "the current adds 0.50 m/s (adds nothing there)" in said


def test_where_there_is_no_current_to_speak_of_it_is_no_reason() -> None:
    still = [replace(row, duration_s=row.length_m / 1.001) for row in (OTHER, BEST)]
    said = CaseFacts([replace(still[0], fuel=960.0), replace(still[1], fuel=1000.0)], 0.004)
    assert said.is_still
    assert said.because() == ("40.0 km shorter than west; there is no current to speak of.")
    assert not CaseFacts(still, 0.02).is_still
    assert not CaseFacts([BEST, OTHER], 0.004).is_still


def test_a_side_is_proven_only_by_a_bound_above_the_best_fuel() -> None:
    def certainty(fuel: float | None) -> str:
        sides = None if fuel is None else fuel
        return CaseFacts([BEST, OTHER], other_sides_fuel=sides).certainty()

    assert certainty(918.0) == ("Proven in this current: any other side needs at least 2.0 % more.")
    # A bound stops once it decides.
    assert certainty(900.5).endswith("any other side needs more.")
    assert certainty(810.0) == "Not proven: a way on the other side may save up to 10.0 %."
    # The gap is a quarter of the bound, a fifth of the fuel.
    # A bound at a price of time may be far below, and even below 0: that of all sides is better.
    assert certainty(-2400.0) == certainty(None)
    loose = replace(BEST, optimality_gap=3.7)
    assert "no useful bound" in CaseFacts([loose, OTHER], other_sides_fuel=-1.0).certainty()
    assert certainty(None) == "Not proven: a way on any side may save up to 20.0 %."
    assert CaseFacts([BEST, TWIN], other_sides_fuel=918.0).certainty() == ""
    assert CaseFacts([BEST]).certainty() == ""


def test_the_lead_is_counted_from_the_best() -> None:
    assert CaseFacts([BEST, TWIN, OTHER]).lead() == (
        "The best way east of island 1 needs 11.1 % more fuel"
    )
    assert CaseFacts([BEST]).lead() == ""


def test_ways_name_islands_on_the_same_side_together() -> None:
    passages = [Passage("west", (name,)) for name in ("1", "4", "Isle")]
    straits = (Passage("between", ("2", "3")), Passage("between", ("5", "6")))
    assert replace(BEST, passages=tuple(passages)).way == "west of island 1, island 4 and Isle"
    assert replace(BEST, passages=(passages[0], *straits, passages[1])).way == (
        "west of island 1, between islands 2 and 3, between islands 5 and 6, west of island 4"
    )
    assert replace(BEST, passages=()).way == ""


def test_on_a_chart_with_depths_the_clearance_is_from_shoals_too() -> None:
    plain = " ".join(CaseFacts([BEST]).verdict())
    with_depths = " ".join(CaseFacts([replace(BEST, uncharted_share=0.0)]).verdict())
    assert " from land; " in plain
    assert " from no-go areas; " in with_depths


def test_the_bound_is_written_as_fuel_is() -> None:
    energy = Energy("Wh", 1 / 3600, 1 / 3600, math.nan)
    best = replace(BEST, fuel=16_770_000.0, optimality_gap=0.03, energy=energy)
    text = " ".join(CaseFacts([best]).verdict())
    assert "needs less than 4,522 Wh; this one is within 3.0 %" in text


def test_a_bound_below_half_the_fuel_is_called_of_no_use() -> None:
    loose = replace(BEST, optimality_gap=3.7)
    season = CaseFacts([loose, replace(OTHER, optimality_gap=3.9)])
    text = " ".join(season.verdict())
    assert "There is no useful bound on what a better route could save" in text
    assert "no useful bound" in season.certainty()
    assert gap_figure(3.7) == "no useful bound"
    assert gap_figure(1.0) == "100.0 %"
    assert "370" not in text


def test_of_a_current_that_is_not_known_nothing_is_proven() -> None:
    still = [replace(row, duration_s=row.length_m / 1.001) for row in (OTHER, BEST)]
    routes = [replace(still[0], fuel=960.0), replace(still[1], fuel=1000.0)]
    sides = 970.0
    known = CaseFacts(routes, 0.004, other_sides_fuel=sides)
    assert known.certainty().startswith("Proven in this current")
    assert "needs less than" in " ".join(known.verdict())
    said = replace(known, lacks_current=True)
    assert said.because() == "40.0 km shorter than west."
    assert said.certainty() == "Not proven: the current on the way is not known."
    for claim in ("Proven", "no current to speak of", "needs less than", "save up to", "m/s"):
        assert claim not in " ".join(said.verdict())
