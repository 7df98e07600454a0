"""Positions from NMEA and JSON: the traits of real receivers, and damage of every kind."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from pipeline.voyage.under_way import Fix, last_fix, positions
from tests.pipeline.voyage.sailing import rmc, summed

# A receiver's output as encyclopaedias show it; position and time worked out by hand.
PUBLISHED = b"$GPRMC,092751.000,A,5321.6802,N,00630.3371,W,0.06,31.66,280511,,,A*45"
AT = datetime(2011, 5, 28, 9, 27, 51, tzinfo=UTC).timestamp()


def one(line: bytes | str) -> Fix:
    (found,) = positions(line.encode() if isinstance(line, str) else line)
    return found


@pytest.mark.parametrize("end", [b"", b"\r", b"\r\n", b"  \r\n"])
@pytest.mark.parametrize("talker", [b"GP", b"GN", b"GL", b"GA", b"BD", b"II"])
def test_a_sentence_is_read_whoever_sends_it(talker: bytes, end: bytes) -> None:
    body = talker + PUBLISHED[3:-3]
    found = one(summed(body.decode()).encode() + end)
    assert found.time == AT
    assert found.lat == pytest.approx(53 + 21.6802 / 60, abs=1e-12)
    assert found.lon == pytest.approx(-(6 + 30.3371 / 60), abs=1e-12)


def test_the_checksum_counts_in_either_case() -> None:
    line = summed("GPRMC,092751.000,A,5321.6802,N,00630.3371,W,0.09,31.66,280511,,,A")
    assert line[-2:] == "4A"
    assert one(line) == one(line[:-2] + line[-2:].lower())
    for place in range(1, len(line) - 3):
        changed = line[:place] + chr(ord(line[place]) ^ 1) + line[place + 1 :]
        assert not list(positions(changed.encode()))


@given(
    lon=st.floats(-180, 180),
    lat=st.floats(-90, 90),
    seconds=st.integers(0, 10**8),
    decimals=st.integers(0, 8),
)
def test_what_is_written_is_read(lon: float, lat: float, seconds: int, decimals: int) -> None:
    found = one(rmc(float(seconds), lon, lat, decimals=decimals))
    assert abs(found.lon - lon) <= 0.51 * 10**-decimals / 60 + 1e-12
    assert abs(found.lat - lat) <= 0.51 * 10**-decimals / 60 + 1e-12


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("GPRMC,092751.000,V,5321.6802,N,00630.3372,W,0.06,31.66,280511,,,N", "void"),
        ("GPRMC,092751.000,A,5321.6802,N,00630.3372,W,0.06,31.66,280511,,,N", "void"),
        ("GPRMC,,V,,,,,,,,,,N", "void"),
        ("GPRMC,092751.000,A,,,,,0.06,31.66,280511,,,A", "void"),
        ("GPRMC,092751.000,A,5321.6802,N,00630.3372,W,,,280511,,", "fix"),
        ("GPRMC,092751,A,5321,N,00630.,W,,,280511,,,A,V", "fix"),
        ("GPRMC,092760.99,A,5321,N,00630,W,,,280511,,,A", "fix"),
        ("GPRMC,092761,A,5321,N,00630,W,,,280511,,,A", "broken"),
        ("GPRMC,242751,A,5321,N,00630,W,,,280511,,,A", "broken"),
        ("GPRMC,092751,A,5360,N,00630,W,,,280511,,,A", "broken"),
        ("GPRMC,092751,A,9001,N,00630,W,,,280511,,,A", "broken"),
        ("GPRMC,092751,A,5321,X,00630,W,,,280511,,,A", "broken"),
        ("GPRMC,092751,A,5321,N,18001,W,,,280511,,,A", "broken"),
        ("GPRMC,092751,A,5321,N,00630,W,,,310211,,,A", "broken"),
        ("GPRMC,092751,A,5321,N", "broken"),
        ("GPRMC,", "broken"),
        ("GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,", "other"),
        ("PGRME,15.0,M,45.0,M,25.0,M", "other"),
    ],
)
def test_sentences_without_a_position_are_passed_over(body: str, expected: str) -> None:
    assert len(list(positions(summed(body).encode()))) == (expected == "fix")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ('{"time": 1e9, "lon": 1, "lat": -2}', "fix"),
        ('{"class":"TPV","mode":3,"time":"2011-05-28T09:27:51.000Z","lat":53.4,"lon":-6.5}', "fix"),
        ('{"class":"TPV","mode":1}', "void"),
        ('{"class":"VERSION","release":"3.22"}', "other"),
        ('{"time": "2011-05-28T09:27:51", "lon": 1, "lat": 2}', "broken"),
        ('{"time": 1e300, "lon": 1, "lat": 2}', "broken"),
        ('{"time": NaN, "lon": 1, "lat": 2}', "broken"),
        ('{"time": 1, "lon": NaN, "lat": 2}', "broken"),
        ('{"time": 1, "lon": true, "lat": 2}', "broken"),
        (f'{{"time": 1, "lon": 1{"0" * 400}, "lat": 2}}', "broken"),
        ('{"time": 1, "lat": 2}', "broken"),
        ('{"time": 1, "lon": "1", "lat": 2}', "broken"),
        ('{"time": 1, "lon": 1', "broken"),
        (f'{{"a": {"[" * 3000}', "broken"),
        ("!AIVDM,1,1,,A,13u?etPv2;0n:dDPwUM1U1Cb069D,0*24", "other"),
        ("12.5 119.3", "broken"),
        ("\x00\xff", "broken"),
    ],
)
def test_other_lines(line: str, expected: str) -> None:
    assert len(list(positions(line.encode("latin-1")))) == (expected == "fix")


def test_glued_lines_give_what_is_whole_in_them() -> None:
    other = rmc(5.0, 119.0, 9.0).encode()
    assert len(list(positions(other + other))) == 2
    assert len(list(positions(other[:30] + other))) == 1
    objects = b'{"time": 1, "lon": 1, "lat": 2} {"time": 2, "lon": 1, "lat": 2}' + other
    assert len(list(positions(objects))) == 3
    assert list(positions(b"{}" * 2000)) == []
    assert len(list(positions(b"\\s:r1*1A\\" + other))) == 1


@given(st.binary(max_size=200))
def test_no_bytes_are_fatal(line: bytes) -> None:
    assert all(isinstance(found, Fix) for found in positions(line))


def test_the_last_position_is_found_near_the_end_of_a_long_file(tmp_path: Path) -> None:
    file = tmp_path / "log"
    lines = [rmc(float(second), 119.0, 9.0) for second in range(20_000)]
    file.write_text("\n".join([*lines, "$GPGSV,cut", "!"]))
    found = last_fix(file)
    assert found is not None
    assert found.time == one(lines[-1]).time
    file.write_text("nothing")
    assert last_fix(file) is None


def test_json_of_a_position_is_that_of_its_sentence() -> None:
    sentence = one(PUBLISHED)
    as_json = {"time": "2011-05-28T10:27:51+01:00", "lon": sentence.lon, "lat": sentence.lat}
    assert one(json.dumps(as_json)) == sentence
