"""Small waters across the middle of Palawan, quick to plan in: how a scenario there begins."""

from __future__ import annotations


def small_waters(name: str) -> str:
    """Give a scenario's first lines as TOML: all but its chart, its seasons and its planner."""
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
