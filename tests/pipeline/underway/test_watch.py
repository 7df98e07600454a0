"""What a watch says of a vessel that sails, drifts off, comes late, or is reported badly."""

from __future__ import annotations

import itertools
import random
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pipeline.stages.finished import FinishedSeason, finished_season
from pipeline.underway.reports import Fix, LineCutter, reports
from pipeline.underway.track import Track
from pipeline.underway.watch import Watch, watch_of
from tests.pipeline.underway.sailing import rmc, sailed, waypoints
from tests.pipeline.underway.test_track import features


def watched(results: Path, lines: list[str]) -> tuple[list[dict[str, Any]], Watch]:
    watch = watch_of(finished_season(results, ""), None, 600.0)
    found = [
        event for line in lines for report in reports(line.encode()) for event in watch.take(report)
    ]
    return found, watch


def voyage(results: Path, seconds: np.ndarray[Any, Any], delay_s: float = 0.0) -> list[str]:
    """Sentences of a vessel on its plan, all of it so much later."""
    return [
        rmc(at + delay_s, *place)
        for at, place in zip(seconds.tolist(), sailed(results, seconds).tolist(), strict=True)
    ]


def duration(results: Path) -> float:
    return float(waypoints(results)[-1]["properties"]["time_s"])


def test_a_vessel_on_its_plan_is_on_plan_until_it_arrives(results: Path) -> None:
    seconds = np.arange(0.0, duration(results) + 300, 10.0)
    found, watch = watched(results, voyage(results, seconds))
    assert {one["event"] for one in found} == {"on_plan"}
    assert all(one["proof"] == "holds" and one["off_m"] < 1 for one in found)
    assert all(abs(one["late_min"]) < 0.2 for one in found)
    assert [one["arrived"] for one in found] == [False] * (len(found) - 1) + [True]
    assert len(found) == 1 + int(duration(results) // 600) + 1
    assert watch.counts["position"] == len(seconds)


def test_off_its_plan_it_is_off_once_and_a_new_plan_is_advised(results: Path) -> None:
    seconds = np.arange(0.0, 1200.0, 10.0)
    places = sailed(results, seconds)
    limit = waypoints(results)[0]["properties"]["port_m"]
    places[40:80, 1] += 2 * limit / 110_600  # to the north: it sails about east
    lines = [rmc(at, *place) for at, place in zip(seconds, places.tolist(), strict=True)]
    found, watch = watched(results, lines)
    assert [one["event"] for one in found] == ["on_plan", "off_plan", "replan", "on_plan"]
    off, advice, back = found[1:]
    assert off["proof"] == advice["proof"] == "void"
    assert (off["side"], off["limit_m"]) == ("port", pytest.approx(limit, abs=0.1))
    assert off["off_m"] == pytest.approx(2 * limit, rel=0.1)
    assert advice["because"] == ["off_plan"]
    assert (off["time"], back["time"]) == ("2026-11-22T06:26:50Z", "2026-11-22T06:33:30Z")
    # The first position so far off is not believed before the next one agrees.
    assert watch.counts["stray"] == 2


def test_beyond_its_lateness_the_proof_is_void(results: Path) -> None:
    seconds = np.arange(0.0, 3000.0, 60.0)
    for delay_s, late in ((3500.0, False), (3700.0, True)):
        found, _ = watched(results, voyage(results, seconds, delay_s))
        assert ("late" in {one["event"] for one in found}) == late
        assert ("replan" in {one["event"] for one in found}) == late
        assert {one["proof"] for one in found} == {"void" if late else "holds"}
        assert found[0]["late_min"] == pytest.approx(delay_s / 60, abs=0.1)
        assert found[0]["may_be_late_min"] == 60.0


def test_flapping_about_the_limit_says_little(results: Path) -> None:
    seconds = np.arange(0.0, 1200.0, 1.0)
    places = sailed(results, seconds)
    limit = waypoints(results)[0]["properties"]["port_m"]
    places[:, 1] += np.where(np.arange(1200) % 2, 0.98, 1.06) * limit / 110_600
    lines = [rmc(at, *place) for at, place in zip(seconds, places.tolist(), strict=True)]
    found, _ = watched(results, lines)
    assert 2 < len(found) <= 3 * 1200 / 60 + 3


def test_a_false_first_position_does_not_silence_the_watch(results: Path) -> None:
    seconds = np.arange(0.0, 100.0, 10.0)
    false = rmc(20 * 365 * 86_400.0, *sailed(results, seconds[:1])[0].tolist())
    found, watch = watched(results, [false, *voyage(results, seconds)])
    assert [one["event"] for one in found][-1] == "on_plan"
    assert found[-1]["time"] == "2026-11-22T06:20:10Z"
    assert watch.counts["stray"] == 1


def test_what_is_no_position_is_counted(results: Path) -> None:
    seconds = np.arange(-50.0, 50.0, 10.0)
    damaged = [line.replace("GP", "GN") for line in voyage(results, seconds)]  # wrong sums
    pairs = zip(voyage(results, seconds), damaged, strict=True)
    lines = [text for both in pairs for text in both]
    again = rmc(40.0, *sailed(results, seconds[-1:])[0].tolist(), talker="GN")
    found, watch = watched(results, [*lines, again, "$GPRMC,12", "{}", "$GPGSV,1,1,00*79"])
    assert len(found) == 1
    counts = watch.counts
    assert (counts["early"], counts["void"], counts["other"]) == (5, 1, 1)
    assert (counts["broken"], counts["repeated"]) == (len(seconds) + 1, 1)
    assert counts["position"] == len(seconds)


@pytest.fixture(scope="module")
def stream(results: Path) -> bytes:
    """A voyage with a slow drift off and back, and each third line damaged."""
    rng = random.Random(5)  # noqa: S311 - a test's seed
    seconds = np.arange(0.0, 6000.0, 20.0)
    places = sailed(results, seconds)
    places[:, 1] += 0.01 * np.sin(seconds / 900)
    lines = [rmc(at, *place).encode() for at, place in zip(seconds, places.tolist(), strict=True)]
    for at in range(0, len(lines), 3):
        place = rng.randrange(len(lines[at]))
        lines[at] = lines[at][:place] + rng.randbytes(3) + lines[at][place:]
    return b"\r\n".join(lines)


Events: TypeAlias = tuple[list[dict[str, Any]], dict[str, int]]


def events(season: FinishedSeason, chunks: list[bytes]) -> Events:
    """What is said of a stream that comes in chunks, and what is counted."""
    watch, cutter = watch_of(season, None, 600.0), LineCutter()
    lines = [line for chunk in chunks for line in cutter.lines(chunk)] + cutter.last()
    found = [e for line in lines for one in reports(line) for e in watch.take(one)]
    return found, dict(watch.counts)


@pytest.fixture(scope="module")
def uncut(results: Path, stream: bytes) -> tuple[FinishedSeason, Events]:
    """The season, and what is said of the whole stream."""
    season = finished_season(results, "")
    whole = events(season, [stream])
    assert {one["event"] for one in whole[0]} == {"on_plan", "off_plan", "replan"}
    assert whole[1]["broken"] > 50
    return season, whole


@given(cuts=st.lists(st.integers(0, 20_000), max_size=40))
def test_the_events_are_the_same_however_the_stream_is_cut(
    uncut: tuple[FinishedSeason, Events], stream: bytes, cuts: list[int]
) -> None:
    season, whole = uncut
    places = [0, *sorted(cuts), len(stream)]
    chunks = [stream[a:b] for a, b in itertools.pairwise(places)]
    assert events(season, [*chunks[:-1], stream[places[-2] :]]) == whole


def test_a_round_trip_is_not_over_where_it_begins() -> None:
    ends = [(119.0, 9.0), (119.5, 9.0), (119.5, 9.1), (119.0, 9.0)]
    watch = Watch(Track.of(features(ends)), ("A", "B", "C", "A"), 0.0, 0.05, depends_on_time=True)
    (first,) = watch.take(Fix(60.0, 119.0005, 9.0))
    assert (first["leg"], first["arrived"]) == ("A to B", False)
    # Nor if nothing is known of its departure: it lies there, and may not have left yet.
    watch = Watch(Track.of(features(ends)), ("A", "B", "C", "A"), None, 0.05, depends_on_time=True)
    (first,) = watch.take(Fix(60.0, 119.0, 9.00001))
    assert (first["leg"], first["arrived"]) == ("A to B", False)


def test_a_vessel_that_waits_stays_on_the_way_out() -> None:
    """Out and back through the same water: a vessel that waited does not count as coming back."""
    ends = [(119.0, 9.0), (119.5, 9.0), (119.0, 9.0)]
    track = Track.of(features(ends))
    watch = Watch(track, ("A", "B", "A"), 0.0, 0.05, depends_on_time=True, every_s=600.0)
    out_s = 0.4 * track.due_s[track.leg == 1][0]
    sailing = [(at, 119.0 + 0.2 * at / out_s) for at in np.linspace(0.0, out_s, 60)]
    waiting = [(out_s + at, 119.2) for at in np.arange(60.0, 3 * out_s, 60.0)]
    found = [one for at, lon in sailing + waiting for one in watch.take(Fix(at, lon, 9.0))]
    assert {one["leg"] for one in found} == {"A to B"}
    assert found[-1]["late_min"] == pytest.approx(3 * out_s / 60, rel=0.05)
    assert {"late", "replan"} <= {one["event"] for one in found}
