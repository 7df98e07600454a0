"""What the columns of all layers mean: the names a reader sees, with units, and a sentence each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Field:
    """A column's name for people, with its unit in brackets, and what it says."""

    alias: str
    meaning: str


FIELDS = {
    "fid": Field("Feature", "Number of the feature in its layer"),
    "season": Field("Season", "As the scenario names it"),
    "rank": Field("Rank", "1 is the season's best route; 0 is a class that fell away"),
    "homotopy": Field(
        "Way round the islands",
        "Equal for two routes of a season that can be pushed into each other across water",
    ),
    "side": Field("Side", "The side of the greatest island between start and goal it passes on"),
    "fuel": Field("Fuel (planner's units)", "Eq. 4 along the route, in the scenario's scale"),
    "fuel_per_distance": Field(
        "Fuel per distance (planner's units/m)", "Fuel by the planner's own, scaled length"
    ),
    "length_m": Field("Length (m)", "True geodesic length"),
    "clearance_m": Field(
        "Clearance (m)", "Least true distance to what the chart forbids, before it was simplified"
    ),
    "duration_s": Field("Duration (s)", "At true scale"),
    "optimality_gap": Field(
        "Optimality gap (share)",
        "How far the fuel may be above the least possible: 0.02 is 2 percent",
    ),
    "trials": Field("Hard-over turns", "Hard-over turns flown along the route"),
    "collisions": Field("Collisions", "Hard-over turns that met land"),
    "sequence": Field("Number", "Place in the route; 1 is the start"),
    "course_deg": Field("Course (° true)", "Of the leg that leaves here; none at the goal"),
    "leg_length_m": Field("Leg (m)", "True length of the leg that leaves here"),
    "time_s": Field("Time (s)", "Since departure, at true scale"),
    "speed_over_ground_m_s": Field(
        "Speed over ground (m/s)", "Mean of the leg that leaves here, current included"
    ),
    "rejected_because": Field("Fell away because", "Empty where the class has a route"),
    "triangles": Field("Triangles", "Number of triangles in the channel"),
    "vertices": Field("Vertices", "Number of vertices of the polygon"),
    "padding_min_m": Field("Least padding (m)", "Least of all constrained edges, true metres"),
    "padding_max_m": Field("Most padding (m)", "Most of all constrained edges, true metres"),
    "u": Field("To east (m/s)", "Eastward surface current"),
    "v": Field("To north (m/s)", "Northward surface current"),
    "speed": Field("Speed (m/s)", "Speed of the surface current"),
    "direction": Field("Direction (° true)", "Towards which the current sets"),
    "collided": Field("Met land", "Whether a hard-over turn from here met land"),
}
"""Column -> what it means; a column has the same meaning in every layer."""
