"""Scenario files with any fault are refused in some lines, and never end in a traceback.

They are the catalogue's own, with their tables or their text changed.
"""

import copy
import datetime as dt
import json
import math
import random
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import RequestError
from pipeline.scenario import catalogue
from pipeline.scenario.loading import load_scenario
from tests.robustness.limits import TooSlowError, cpu_limit, draw, failure, number
from tests.robustness.renew_processes import MAX_LINE, MAX_LINES, Renew

_DAY = dt.date(2024, 7, 1)
_ODD_TEXTS = (
    *("", " ", "a" * 70, "x" * 5000, "..", "./", "~", "~nobody-of-this-name/charts", "/"),
    *("/dev/null", "./no/such.gpkg", "*.nc", "[*.nc", "a\x00b.nc", "./\x00", "palawan-season\n"),
    *("ÄÖÜ-ß", "ναῦς", "船", "🚢" * 20, "\u202etxet", "\ufeff", "é́́́", "{0}", "{0.__class__}"),
    *("%s", "$HOME", "<b>", "'", '"', "\\", "EPSG:4326", "EPSG:999999", "EPSG:", "+proj="),
    *("+proj=tmerc +lat_0=nan", "2024-07", "2024-13", "0000-01", "0001-01", "9999-12"),
    *("9999-12-31", "2024-07-01T00:00Z", "2024-02-30T25:61Z", "adaptive", "none", "osm-land"),
    *("s57", "natural-earth", "embedded-palawan", "copernicus-glorys-monthly", "paper-asv"),
    *("nan", "1e400"),
)
_ODD_NUMBERS = (
    *(0, -0.0, 1, -1, 2, 7, 8, 181, 360, -180, 90, 0.5, 1e-300, 5e-324, -1e-300, 1e9, 1e15, 1e22),
    *(1e154, 1e300, 1.7976931348623157e308, -1.7976931348623157e308, math.nan, math.inf),
    *(-math.inf, 2**31, 2**63 - 1, 2**63, -(2**63), 10**30, 10**400),
)
_OTHER: tuple[Any, ...] = (
    *(True, False, _DAY),
    dt.datetime(2024, 7, 1, 6, 0),  # noqa: DTZ001 - a local time of TOML
    dt.datetime(2024, 7, 1, 6, 0, tzinfo=dt.UTC),
    dt.datetime(1, 1, 1, tzinfo=dt.timezone(dt.timedelta(hours=23))),
    dt.datetime(9999, 12, 31, 23, 59, tzinfo=dt.timezone(dt.timedelta(hours=-23))),
    *(
        dt.time(6, 0),
        [],
        {},
        [[]],
        [{}],
        [None.__class__.__name__],
        [0, 0],
        [0, 0, 0, 0],
        [0, 0, 1, 1],
    ),
    *([-180, -90, 180, 90], [-180, -90, 360, 90], [[0, 0], [1, 0], [0, 0]]),
    *([[0, 0], [1, 1], [1, 0], [0, 1]], [[0, 0], [math.nan, 1], [1, 0]]),
    [[0, 0], [1e308, 1], [-1e308, 1e308]],
    *({"path": "./x.gpkg", "name": "osm-land"}, {"amplitude": 1e308}, {"u": 1, "v": 1}),
    *({"bbox": [0, 0, 1, 1]}, {"": ""}, {"a": {"b": {"c": [1, {"d": 2}]}}}),
)


def mutated(rng: random.Random) -> bytes:
    """Make the content of a file: a catalogue scenario with one to four faults."""
    name = rng.choice(catalogue.names("scenarios"))
    return with_faults(rng, (catalogue.root() / "scenarios" / f"{name}.toml").read_bytes())


def with_faults(rng: random.Random, content: bytes) -> bytes:
    """Make one to four faults in a TOML file's content: in its tables, its text or its bytes."""
    kind = rng.random()
    if kind < 0.3:
        return with_text_faults(rng, content)
    table = tomllib.loads(content.decode())
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        _change(rng, table)
    changed = toml_of(table).encode("utf-8", "surrogatepass")
    return oddly_encoded(rng, changed) if kind < 0.35 else changed


def oddly_encoded(rng: random.Random, content: bytes) -> bytes:
    """Write a text as no editor should: another encoding, other ends of lines, NUL, no end."""
    text = content.decode("utf-8", "replace")
    return rng.choice(
        (
            lambda: b"\xef\xbb\xbf" + content,
            lambda: text.encode("utf-16"),
            lambda: text.encode("utf-16-le"),
            lambda: text.encode("utf-32"),
            lambda: text.encode("latin-1", "replace") + b"# \xe9\n",
            lambda: content.replace(b"\n", b"\r\n"),
            lambda: content.replace(b"\n", b"\r"),
            lambda: content.replace(b"\n", b"\n\0", 1),
            lambda: content + b"\0" * 1000,
            lambda: content + b"# " + b"x" * 10_000_000,
            lambda: content.replace(b"\n", b" \x1b[31m\n", 2),
            lambda: content * 2,
            lambda: content + b"[a]\n" * 20_000,
            lambda: content + b"x = " + b"[" * 200 + b"]" * 200,
            lambda: content + b".".join([b"a"] * 5000) + b" = 1\n",
        )
    )()


def toml_of(table: dict[str, Any]) -> str:
    """Spell a table as TOML, with inline tables below its own keys."""
    return "".join(f"{json.dumps(key)} = {_spelled(value)}\n" for key, value in table.items())


def _spelled(value: object) -> str:
    """Spell a value as TOML does."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            return str(value)
        case str():
            return json.dumps(value).replace("\x7f", "\\u007f") if value.isascii() else _text(value)
        case dict():
            inside = ", ".join(f"{_spelled(str(k))} = {_spelled(v)}" for k, v in value.items())
            return f"{{{inside}}}"
        case list():
            return f"[{', '.join(map(_spelled, value))}]"
        case dt.date() | dt.time():
            return value.isoformat()
    raise TypeError(f"{value!r} can't be spelled as TOML")


def _text(value: str) -> str:
    """Spell a text; characters beyond ASCII stay as they are, controls are escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def places_in(value: object, path: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """List the paths of all values in a table of TOML or JSON, nested ones included."""
    items: list[tuple[str | int, object]] = []
    if isinstance(value, dict):
        items = list(value.items())
    elif isinstance(value, list):
        items = list(enumerate(value))
    found = []
    for key, inner in items:
        found += [(*path, key), *places_in(inner, (*path, key))]
    return found


def _odd_value(rng: random.Random) -> object:
    """Choose a value that a key of another kind, or of this one, may not expect."""
    return copy.deepcopy(rng.choice(rng.choice((_ODD_TEXTS, _ODD_NUMBERS, _OTHER))))


def _change(rng: random.Random, table: dict[str, Any]) -> None:
    """Make one fault in a table: a value, key or item is replaced, dropped, doubled or moved."""
    places = places_in(table)
    if not places:
        table["start"] = _odd_value(rng)
        return
    *upper, key = rng.choice(places)
    owner: Any = table
    for step in upper:
        owner = owner[step]
    kind = rng.choice(("replace", "replace", "replace", "drop", "double", "nest", "move", "key"))
    if kind == "replace":
        owner[key] = _odd_value(rng)
    elif kind == "drop":
        del owner[key]
    elif kind == "double":
        owner[key] = [copy.deepcopy(owner[key])] * rng.choice((2, 3, 50))
    elif kind == "nest":
        for _ in range(rng.choice((1, 2, 40))):
            owner[key] = rng.choice(([owner[key]], {"x": owner[key]}))
    elif kind == "move":
        table[str(rng.choice(places)[-1])] = copy.deepcopy(owner[key])
    elif isinstance(owner, dict):
        owner[rng.choice((*_ODD_TEXTS, *(str(place[-1]) for place in places)))] = _odd_value(rng)
    else:
        owner.insert(int(key), _odd_value(rng))


def with_text_faults(rng: random.Random, given: bytes) -> bytes:  # noqa: C901 - one for each kind
    """Change the bytes of a text file."""
    content = bytearray(given)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at, kind = rng.randrange(len(content) + 1), rng.randrange(9)
        upto = min(len(content), at + rng.choice((1, 2, 10, 200)))
        if kind == 0:
            del content[at:upto]
        elif kind == 1:
            content[at:at] = bytes([rng.randrange(256)])
        elif kind == 2:
            content[at:at] = rng.choice(_ODD_TEXTS).encode()
        elif kind == 3:
            content[at:at] = content[at:upto] * rng.choice((1, 2, 30))
        elif kind == 4:
            content[at:at] = b"[" * rng.choice((1, 5, 2000))
        elif kind == 5:
            lines = content.splitlines(keepends=True) or [bytearray()]
            lines.insert(rng.randrange(len(lines)), rng.choice(lines))
            content = bytearray(b"".join(lines))
        elif kind == 6:
            lines = content.splitlines(keepends=True) or [bytearray()]
            rng.shuffle(lines)
            content = bytearray(b"".join(lines))
        elif kind == 7:
            digits = [i for i, byte in enumerate(content) if chr(byte).isdigit()]
            if digits:
                i = rng.choice(digits)
                content[i : i + 1] = rng.choice(
                    (b"9" * 400, b"9" * 5000, b"nan", b"-", b"1e308", b"0x7f", b".", b"")
                )
        else:
            content = content[:at]
    return bytes(content)


SAMPLE = 200


def outcomes(folder: Path, cases: range, renew: Renew | None = None) -> tuple[list[str], int, int]:
    """Load mutated files: descriptions of failures, and how many were valid and refused.

    What is valid is also checked by the command line, where there is one to do so.
    """
    failures: list[str] = []
    valid = refused = 0
    path = folder / "mutated.toml"
    for case in cases:
        path.write_bytes(mutated(draw("scenarios", case)))
        try:
            with cpu_limit():
                load_scenario(str(path))
            valid += 1
            why = "" if renew is None else renew(["check", str(path)], folder).fault()
            failures += [f"case {case}: {why}"] if why else []
        except RequestError as error:
            refused += 1
            failures += [f"case {case}: {why}" for why in _faults_of(error)]
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - what must not happen
            failures.append(failure(case, error))
    return failures, valid, refused


def _faults_of(error: RequestError) -> Iterator[str]:
    """Say what is wrong with the faults of an error."""
    if not all(fault.strip() for fault in error.faults) or not error.faults:
        yield f"a fault without words: {error.faults}"
    if len(error.faults) > MAX_LINES:
        yield f"{len(error.faults)} faults"
    longest = max(error.faults, key=len)
    if len(longest) > MAX_LINE:
        yield f"a fault of {len(longest)} characters: {longest}"


def test_a_sample_of_faulty_files_is_refused(tmp_path: Path) -> None:
    failures, valid, refused = outcomes(tmp_path, range(SAMPLE))
    assert not failures, "\n".join(failures)
    assert refused > valid > 0


@pytest.mark.slow
def test_many_faulty_files_are_refused(tmp_path: Path) -> None:
    files = number("scenarios", 2000)
    with Renew() as renew:
        failures, valid, refused = outcomes(tmp_path, range(files), renew)
        print(f"{files} scenarios: {refused} refused, {valid} valid: {dict(renew.met)}")  # noqa: T201
    assert not failures, "\n".join(failures)
    assert refused > valid > files / 100
