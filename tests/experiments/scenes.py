"""Scenes of the experiments' tests."""

import math

import numpy as np
from shapely import Polygon, box

import renew
from renew.voyage.voyage import Voyage, Waters

VESSEL = renew.Vessel(speed=1.0, turn_rate=math.radians(35), length=2.0)
CURRENT = renew.GyreCurrent(0.6, 60, 60)


def islands_voyage() -> Voyage:
    """Two islands in a gyre, 60 m by 60 m."""
    islands = [Polygon([(18, 20), (28, 18), (30, 30), (20, 31)]), box(36, 34, 44, 46)]
    chart = renew.Chart(box(0, 0, 60, 60), islands)
    start, goal = np.array([6.0, 7.0]), np.array([54.0, 52.0])
    return Voyage(Waters(chart, CURRENT), VESSEL, start, goal, "projected")
