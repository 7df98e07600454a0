"""Names and meanings of the columns of all layers, as a GIS shows them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Field:
    """A column's name for readers, with its unit in brackets, and its meaning."""

    alias: str
    meaning: str


FIELDS = {
    "fid": Field("Feature", "Number of the feature in its layer"),
    "season": Field("Season", "Name of the season in the scenario"),
    "rank": Field("Rank", "1 is the season's best route; 0 is a rejected class"),
    "homotopy": Field(
        "Homotopy class",
        "Way round the islands: equal for two routes of a season that can be moved into each "
        "other without crossing a no-go area",
    ),
    "way": Field("Way", "Islands that it passes, by their numbers or names"),
    "fuel": Field("Fuel (planner's units)", "Eq. 4 along the route, at the scenario's scale"),
    "fuel_per_distance": Field(
        "Fuel per distance (planner's units/m)", "Fuel divided by the planner's scaled length"
    ),
    "length_m": Field("Length (m)", "True geodesic length"),
    "clearance_m": Field(
        "Clearance (m)", "Least true distance to the chart's no-go areas before simplification"
    ),
    "duration_s": Field("Duration (s)", "At true scale"),
    "optimality_gap": Field(
        "Optimality gap (share)",
        "Upper limit of the fuel above the least possible: 0.02 is 2 percent",
    ),
    "trials": Field("Hard-over turns", "Hard-over turns simulated along the route"),
    "collisions": Field("Collisions", "Hard-over turns that met a no-go area"),
    "number": Field("Number", "Of the island in homotopy classes: 1 is the largest of the chart"),
    "name": Field("Name", "Charted name, if there is one; of a waypoint, its name in the route"),
    "kind": Field(
        "Kind",
        "No-go: shoal, uncharted, hazard. Allowed: restricted, traffic. Shut: no-go during its "
        "hours. Depth areas: natural, dredged",
    ),
    "depth_min_m": Field(
        "Least depth (m)", "At chart datum; negative where it dries, empty where it is not charted"
    ),
    "depth_max_m": Field("Greatest depth (m)", "At chart datum; empty where it is not charted"),
    "rule": Field("Rule", "What the chart says about the area, or prescribes in it"),
    "filled_share": Field(
        "Current filled (share)",
        "Share of the length in cells where the current's source has no data: it was filled from "
        "the water around",
    ),
    "uncharted_share": Field(
        "Depth uncharted (share)",
        "Share of the length where no depth is charted; empty for a chart without depths",
    ),
    "sequence": Field(
        "Number", "Of the point in the route, from 1; a leg has the number of its first point"
    ),
    "course_deg": Field("Course (° true)", "Of the leg that leaves here; none at the goal"),
    "leg_length_m": Field("Leg (m)", "True length of the leg that leaves here"),
    "time_s": Field("Time (s)", "Since departure, at true scale"),
    "speed_over_ground_m_s": Field(
        "Speed over ground (m/s)", "Mean of the leg that leaves here, current included"
    ),
    "speed_through_water_m_s": Field(
        "Speed through water (m/s)",
        "Of the leg that leaves here; of a route, the mean over time",
    ),
    "turn_radius_m": Field("Turning radius (m)", "At the waypoint; 0 at start and goal"),
    "port_m": Field("Limit to port (m)", "Cross-track limit of the leg"),
    "starboard_m": Field("Limit to starboard (m)", "Cross-track limit of the leg"),
    "rejected_because": Field("Rejected because", "Empty if the class has a route"),
    "triangles": Field("Triangles", "Number of triangles in the channel"),
    "vertices": Field("Vertices", "Number of vertices of the polygon"),
    "padding_min_m": Field("Minimum padding (m)", "Least of a constrained edge, in true metres"),
    "padding_max_m": Field("Maximum padding (m)", "Greatest of a constrained edge, in true metres"),
    "u": Field("To east (m/s)", "Eastward surface current"),
    "v": Field("To north (m/s)", "Northward surface current"),
    "speed": Field("Speed (m/s)", "Speed of the surface current"),
    "direction": Field("Direction (° true)", "Direction towards which the current sets"),
    "collided": Field(
        "Met a no-go area", "Whether a hard-over turn from here met land or another no-go area"
    ),
}
"""Column -> its field; a column has the same meaning in every layer."""

_TEXT = ("season", "homotopy", "way", "name", "kind", "rule", "rejected_because")
_WHOLE = ("rank", "trials", "collisions", "number", "sequence", "triangles", "vertices")
TYPES: dict[str, type] = {
    **dict.fromkeys(_TEXT, object),
    **dict.fromkeys(_WHOLE, int),
    "collided": bool,
}
"""Column -> its type, where it is not a float."""
