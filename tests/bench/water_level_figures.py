"""Heights of the tide beside two other libraries, and beside the extremes that NOAA publishes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.bench.figure import Figure, at_most
from tests.tide_oracles import PREDICTORS, apart, highest_and_lowest, stations

BEGIN = np.datetime64("2026-11-22")
# HAT and LAT of this station both lie 0.11 m above what its own mean sea level and constants give.
OTHER_LEVEL = "noaa-9415193"


def figures() -> Iterator[Figure]:
    """Yield each station's figures, then the largest of all."""
    found = stations()
    for name, predictor in PREDICTORS.items():
        both = {key: apart(one, predictor, BEGIN) for key, one in found.items()}
        for key, (most, rms) in both.items():
            text = f"{most:.2%} at most, {rms:.2%} rms"
            yield Figure(f"{key} ({found[key].name}) beside {name}", "", text)
        most, rms = np.max([*both.values()], axis=0)
        what = f"{len(both)} stations × 30 days beside {name}, share of the amplitudes' sum"
        yield at_most(f"{what}: most", 100 * float(most), 2.0, " %")
        yield at_most(f"{what}: rms", 100 * float(rms), 0.8, " %")
    off = []
    for key, station in found.items():
        highest, lowest = highest_and_lowest(station)
        high, low = highest - station.datums["HAT"], lowest - station.datums["LAT"]
        text = f"highest {1000 * high:+.0f}, lowest {1000 * low:+.0f} mm"
        yield Figure(f"{key} ({station.name}), 1983-2001 beside HAT and LAT", "", text)
        off += [high - low] if key == OTHER_LEVEL else [high, low]
    yield at_most(
        "beside HAT and LAT: rms", 1000 * float(np.sqrt(np.mean(np.square(off)))), 10.0, " mm", 1
    )
    yield at_most("beside HAT and LAT: most", 1000 * float(np.abs(off).max()), 25.0, " mm", 1)
