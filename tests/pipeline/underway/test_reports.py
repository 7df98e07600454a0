"""Positions from NMEA and JSON: the traits of real receivers, and damage of every kind."""

from __future__ import annotations

import json
import random
from datetime import UTC, datetime

import pytest
from hypothesis import given, strategies as st

from pipeline.underway.reports import Fix, LineCutter, Unread, reports
from tests.pipeline.underway.sailing import rmc, summed

# A receiver's output as encyclopaedias show it; position and time worked out by hand.
PUBLISHED = b"$GPRMC,092751.000,A,5321.6802,N,00630.3371,W,0.06,31.66,280511,,,A*45"
AT = datetime(2011, 5, 28, 9, 27, 51, tzinfo=UTC).timestamp()


def one(line: bytes | str) -> Fix | Unread:
    (found,) = reports(line.encode() if isinstance(line, str) else line)
    return found


def kind(line: bytes | str) -> str:
    found = one(line)
    return "fix" if isinstance(found, Fix) else found.kind


@pytest.mark.parametrize("end", [b"", b"\r", b"\r\n", b"  \r\n"])
@pytest.mark.parametrize("talker", [b"GP", b"GN", b"GL", b"GA", b"BD", b"II"])
def test_a_sentence_is_read_whoever_sends_it(talker: bytes, end: bytes) -> None:
    body = talker + PUBLISHED[3:-3]
    found = one(summed(body.decode()).encode() + end)
    assert isinstance(found, Fix)
    assert found.time == AT
    assert found.lat == pytest.approx(53 + 21.6802 / 60, abs=1e-12)
    assert found.lon == pytest.approx(-(6 + 30.3371 / 60), abs=1e-12)


def test_the_checksum_counts_in_either_case() -> None:
    line = summed("GPRMC,092751.000,A,5321.6802,N,00630.3371,W,0.09,31.66,280511,,,A")
    assert line[-2:] == "4A"
    assert one(line) == one(line[:-2] + line[-2:].lower())
    assert isinstance(one(line), Fix)
    for place in range(1, len(line) - 3):
        changed = line[:place] + chr(ord(line[place]) ^ 1) + line[place + 1 :]
        assert not any(isinstance(found, Fix) for found in reports(changed.encode()))


@given(
    lon=st.floats(-180, 180),
    lat=st.floats(-90, 90),
    seconds=st.integers(0, 10**8),
    decimals=st.integers(0, 8),
)
def test_what_is_written_is_read(lon: float, lat: float, seconds: int, decimals: int) -> None:
    found = one(rmc(float(seconds), lon, lat, decimals=decimals))
    assert isinstance(found, Fix)
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
def test_sentences_without_a_position_are_told_apart(body: str, expected: str) -> None:
    assert kind(summed(body)) == expected


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
    assert kind(line.encode("latin-1")) == expected


def test_glued_lines_give_what_is_whole_in_them() -> None:
    other = rmc(5.0, 119.0, 9.0).encode()
    assert [type(found) for found in reports(other + other)] == [Fix, Fix]
    cut = other[:30] + other
    assert [type(found) for found in reports(cut)] == [Unread, Fix]
    objects = b'{"time": 1, "lon": 1, "lat": 2} {"time": 2, "lon": 1, "lat": 2}' + other
    assert [type(found) for found in reports(objects)] == [Fix, Fix, Fix]
    assert [type(found) for found in reports(b"{}" * 2000)] == [Unread] * 2000
    assert [type(found) for found in reports(b"\\s:r1*1A\\" + other)] == [Fix]


@given(st.binary(max_size=200))
def test_no_bytes_are_fatal(line: bytes) -> None:
    assert all(isinstance(found, Fix | Unread) for found in reports(line))


@given(st.integers(0, 10**6))
def test_lines_are_the_same_however_a_stream_is_cut(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311 - no secret
    lines = [rng.randbytes(rng.choice([0, 5, 80, 4096, 4097, 9000])) for _ in range(4)]
    stream = b"\n".join(line.replace(b"\n", b"") for line in lines) + rng.choice([b"", b"\n"])
    found = []
    for longest in (len(stream) + 1, 1, 50, 5000):
        cutter, taken, at = LineCutter(), list[bytes](), 0
        while at < len(stream):
            size = rng.randint(1, longest) if longest > 1 else 1
            taken += cutter.lines(stream[at : at + size])
            at += size
        found.append(taken + cutter.last())
    assert all(one == found[0] for one in found)
    assert all(kind(one) == "broken" for one in found[0] if len(one) > 4096)


def test_json_of_a_position_is_that_of_its_sentence() -> None:
    sentence = one(PUBLISHED)
    assert isinstance(sentence, Fix)
    as_json = {"time": "2011-05-28T10:27:51+01:00", "lon": sentence.lon, "lat": sentence.lat}
    assert one(json.dumps(as_json)) == sentence
