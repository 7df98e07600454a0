"""Draw voyages north of 60 N and south of 50 S, and run `renew go` on each; no crash is allowed.

    python -m tests.bench.polar_voyages --seed 1 --count 40 --folder /tmp/polar

Some ends lie across 180 degrees, near a pole, in fjords or on land. Where a refusal says where to
move an end, the voyage is run once more from there. Prints a line for each voyage and the number of
runs by exit code; exits with 1 if a run crashed, left a traceback, or ended in time without a plan
or a reason.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyproj
import shapely

from pipeline.sources.land import osm

GEOD = pyproj.Geod(ellps="WGS84")
VESSELS = (
    ("--speed", "9kn", "--length", "20m", "--turning-circle", "90m"),
    ("--speed", "25kn", "--length", "12m", "--turning-circle", "60m"),
    ("--speed", "16kn", "--length", "180m", "--turning-circle", "900m"),
)
# Distances of start and goal, km; short voyages draw near a coast.
SHORT, MIDDLE, LONG = (3.0, 60.0), (60.0, 500.0), (500.0, 4000.0)
# Exit codes with a plan, without a plan for a reason, and of a wrong request.
EXPECTED = (0, 1, 2)
_ADVICE = re.compile(r"at \[(-?[\d.]+), (-?[\d.]+)\]; move (?:the )?(\w+)")


@dataclass(frozen=True)
class Ended:
    """How a run ended: its exit code, None if it was stopped; and what it said."""

    code: int | None
    said: str
    seconds: float

    @property
    def is_crash(self) -> bool:
        return self.code is not None and (
            self.code not in EXPECTED
            or "Traceback" in self.said
            or "please report" in self.said
            or (self.code != 0 and "error: " not in self.said)
        )


def is_land(lon: float, lat: float) -> bool:
    """Whether a position lies on the world's land, by the polygons themselves."""
    near, _ = osm.polygons_near("Osm", shapely.box(lon - 1e-6, lat - 1e-6, lon + 1e-6, lat + 1e-6))
    return bool(shapely.intersects_xy(near.polygons, lon, lat).any())


def near_coast(lon: float, lat: float) -> bool:
    """Whether land lies within a fifth of a degree of latitude."""
    aside = 0.2 / max(np.cos(np.radians(lat)), 0.02)
    box = shapely.box(lon - aside, max(lat - 0.2, -90.0), lon + aside, min(lat + 0.2, 90.0))
    near, _ = osm.polygons_near("Osm", box)
    return bool(shapely.intersects(near.polygons, box).any())


def drawn_end(rng: np.random.Generator, *, coastal: bool, on_land: bool) -> tuple[float, float]:
    """Draw a position evenly over both caps; near a coast, or on land, if asked for."""
    while True:
        if rng.random() < 0.65:
            lat = np.degrees(np.arcsin(rng.uniform(np.sin(np.radians(60)), 1.0)))
        else:
            lat = -np.degrees(np.arcsin(rng.uniform(np.sin(np.radians(50)), 1.0)))
        lon = rng.uniform(-180, 180) if rng.random() < 0.8 else 180 - rng.uniform(0, 5)
        at = round(float(lon), 4), round(float(lat), 4)
        if is_land(*at) == on_land and (not coastal or near_coast(*at)):
            return at


def drawn_voyage(rng: np.random.Generator) -> list[str]:
    """Draw the arguments of `renew go`."""
    least, most = (SHORT, MIDDLE, LONG)[int(rng.integers(3))]
    coastal = most < LONG[1] and rng.random() < 0.8
    while True:
        start = drawn_end(rng, coastal=coastal, on_land=coastal and rng.random() < 0.15)
        for _ in range(50):
            away_m = 1000 * np.exp(rng.uniform(np.log(least), np.log(most)))
            lon, lat, _ = GEOD.fwd(*start, rng.uniform(0, 360), away_m)
            goal = round(float(lon), 4), round(float(lat), 4)
            if not -50 < goal[1] < 60 and not is_land(*goal):
                places = [",".join(map(str, one)) for one in (start, goal)]
                vessel = VESSELS[int(rng.integers(len(VESSELS)))]
                return [*vessel, "--currents", "still", "--", *places]


def run(voyage: list[str], folder: Path, limit_s: float) -> Ended:
    """Run `renew go` in a process of its own."""
    command = [sys.executable, "-m", "pipeline.cli.main", "go", "--quiet", "--offline"]
    began = time.monotonic()
    try:
        ended = subprocess.run(
            [*command, "--output", str(folder), *voyage],
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Ended(None, f"not done in {limit_s:.0f} s", limit_s)
    return Ended(ended.returncode, ended.stderr, time.monotonic() - began)


def followed(voyage: list[str], said: str) -> list[str] | None:
    """Return the voyage with its ends where a refusal says; None without such advice."""
    advised = list(voyage)
    for line in said.splitlines():
        found = _ADVICE.search(line)
        if found is not None:
            moved = found[3] if found[3] in {"start", "goal"} else line.split()[1]
            advised[-2 if moved == "start" else -1] = f"{found[1]},{found[2]}"
    return advised if advised != voyage else None


def main() -> int:
    """Run the voyages of a seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--limit", type=float, default=600.0)
    asked = parser.parse_args()
    codes, crashes = Counter[str](), 0
    for number in range(asked.first, asked.first + asked.count):
        voyage = drawn_voyage(np.random.default_rng([asked.seed, number]))
        for step in ("", " as advised"):
            ended = run(voyage, asked.folder, asked.limit)
            crashes += ended.is_crash
            codes[f"{ended.code}{step}"] += 1
            print(f"{number}{step}: {ended.code} in {ended.seconds:.0f} s: {' '.join(voyage)}")
            print("".join(f"    {line}\n" for line in ended.said.splitlines()), end="", flush=True)
            moved = followed(voyage, ended.said) if ended.code else None
            if moved is None:
                break
            voyage = moved
    print(f"{crashes} crashes; runs by exit code: {dict(codes)}")
    return 1 if crashes else 0


if __name__ == "__main__":
    sys.exit(main())
