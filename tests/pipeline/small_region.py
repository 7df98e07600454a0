"""A small region across the middle of Palawan that is quick to plan in."""


def small_region(name: str) -> str:
    """Return a scenario's first lines as TOML: all but its chart, seasons and planner."""
    return f"""
schema_version = 1
name = "{name}"
vessel = "paper-asv"
scale = 1000
start = [118.40, 10.20]
goal = [118.60, 10.30]
[region]
bbox = [118.3, 9.3, 119.2, 10.4]
"""


def with_stand_in(name: str) -> str:
    """Return a scenario as TOML that prefers a source of currents which needs the network."""
    return (
        small_region(name)
        + """[chart]
tolerance_m = 500
[[seasons]]
name = "summer"
valid = "2024-07"
currents = ["copernicus-glorys-monthly", "embedded-palawan"]
[planner]
classes = 1
"""
    )
