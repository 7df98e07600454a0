"""A small scenario in a plane, planned in a second."""


def small_plane(name: str, classes: int = 1) -> str:
    """Return a valid scenario as TOML: one obstacle between start and goal, one season."""
    return f"""
schema_version = 1
name = "{name}"
vessel = "paper-asv"
start = [10, 50]
goal = [90, 50]
[plane]
extent = [0, 0, 100, 100]
obstacles = [[[40, 30], [60, 30], [60, 70], [40, 70]]]
[[seasons]]
name = "still"
uniform = {{ u = 0.1 }}
[planner]
classes = {classes}
"""
