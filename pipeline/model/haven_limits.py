"""Havens of a run, with the limits on the way to one of them."""

from dataclasses import dataclass

import renew
from pipeline.model.planning import Scene, largest_stretch


@dataclass(frozen=True, slots=True, eq=False)
class HavenLimits:
    """Havens in the plane, and the limits on the way to one of them, true seconds or None."""

    havens: tuple[renew.Haven, ...]
    within_s: float | None
    endurance_s: float | None

    def in_plane(self, scene: Scene, season: str) -> tuple[float | None, float | None]:
        """Return the limits of time (s) and fuel of `renew.cover`: ways keep them in true time."""
        stretch = largest_stretch(scene, season)
        rate = scene.vessel_in(season).fuel_rate
        endurance = None if self.endurance_s is None else rate * self.endurance_s / stretch
        within = None if self.within_s is None else self.within_s / stretch
        return within, endurance
