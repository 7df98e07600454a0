"""How early and how late a vessel may be where it passes."""

from __future__ import annotations

import numpy as np

from renew._types import FloatArray


def early_and_late(
    times: FloatArray, departure: float, lateness: float, min_lateness: float
) -> tuple[FloatArray, FloatArray]:
    """Earliest and latest times (n,), s, at places that are passed at `times` (n,), s.

    Apart by a share `lateness` of the time since departure, and at least by `min_lateness` (s); but
    nobody is anywhere before the departure.
    """
    away = np.maximum(lateness * (times - departure), min_lateness)
    return np.maximum(times - away, np.minimum(times, departure)), times + away
