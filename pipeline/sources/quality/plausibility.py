"""Could the sea run like this? What the figures of a current say against it, whatever its source.

Limits are set by real fields: GLO12 (1 degree, January 2024), DUACS (1/4 degree, February 2019),
OSCAR (1/3 degree, monthly climatology) and the Central Weather Administration's OCM (1/10 degree,
June 2020). Strong evidence is a fault, weak evidence a doubt that the reader is told of.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.sources.quality import component_signs as turned
from pipeline.sources.quality import misregistration as shifted

if TYPE_CHECKING:
    import numpy.typing as npt

    from pipeline.sources.quality.field import Field, Shore

    FloatArray = npt.NDArray[np.float64]
    BoolArray = npt.NDArray[np.bool_]

# Root mean square speed of moving water over a field of at least so many degrees (both ways): above
# the first it is doubted, above the second refused. Real ones reach 0.9, 0.75, 0.52 and 0.44.
_FAST_M_S = ((8.0, 1.0, 1.6), (20.0, 0.8, 1.1), (60.0, 0.6, 0.75), (100.0, 0.5, 0.6))
# Over that many degrees a real field is faster than this.
_SLOW_DEG, _SLOW_M_S = 20.0, 0.02
# Figures that stand for gaps, such as -999 and 1e20, are beyond this.
_FILL_M_S = 900.0
# No two cells of a real field are alike to this share of the speed.
_ALIKE = 1e-6
_FEWEST_CELLS = 20
# Cells this many cells or more from any land on every side should have figures, and cells as far
# inland none. Straits and shallows that a model leaves out make up for some. Of coarse cells fewer.
FAR_CELLS, _FAR_DEG = 3, 0.75
# Contrast of divergences, and its certainty in standard errors, for a doubt and for a fault. Of
# 3000 real windows of 6 to 24 degrees 3 gave a doubt and none a fault.
_CONTRAST, _DOUBTED, _CERTAIN = 0.1, 2.0, 4.0
# Least offset in cells, and figures on land that it explains, as a count and as a share of those to
# be expected. Real fields reach 11 cells and 0.01 over 120 degrees, 16 and, of few, 0.6 over 24.
_SHIFT_DOUBTED = (0.3, 30, 0.03)
_SHIFT_CERTAIN = (0.45, 40, 0.12)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What speaks against a field: `faults` strongly enough to refuse it, `doubts` not."""

    faults: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __add__(self, other: Verdict) -> Verdict:
        """Both together."""
        return Verdict(self.faults + other.faults, self.doubts + other.doubts)


def judged(field: Field, shore: Shore, limit_m_s: float) -> Verdict:
    """Judge a field's speeds (against a limit in m/s), its place and its directions."""
    speeds = speed_verdict(field, limit_m_s)
    if speeds.faults:
        return speeds
    return speeds + _place_verdict(field, shore) + _direction_verdict(field)


def speed_verdict(field: Field, limit_m_s: float) -> Verdict:
    """Some water, some movement, not alike everywhere, and no speed that the sea does not know."""
    u, v = field.u[~field.gap], field.v[~field.gap]
    speed = np.hypot(u, v)
    if not speed.size:
        return Verdict(("it has no figures at all",))
    strongest = float(speed.max())
    if strongest == 0:
        return Verdict(("every speed is 0",))
    if strongest > limit_m_s:
        cause = "a gap's figure" if strongest > _FILL_M_S else "another unit"
        said = f"speeds reach {strongest:.3g} m/s, above {limit_m_s:g}: {cause}, or damaged"
        return Verdict((said,))
    if u.size >= _FEWEST_CELLS and max(np.ptp(u), np.ptp(v)) <= _ALIKE * strongest:
        return Verdict((f"it is the same everywhere ({u[0]:.3g} east, {v[0]:.3g} m/s north)",))
    return _unit_verdict(field, float(np.sqrt(np.mean(speed[speed > 0] ** 2))))


def _unit_verdict(field: Field, usual_m_s: float) -> Verdict:
    """Whether the speeds are those of another unit: 3.6 km/h are 1 m/s."""
    span = min(float(np.ptp(field.lon)), float(np.ptp(field.lat)))
    limits = [limits for wide, *limits in _FAST_M_S if span >= wide]
    if limits and usual_m_s > limits[-1][0]:
        said = (
            f"its water moves at {usual_m_s:.2g} m/s (root mean square over {span:.0f} degrees), "
            f"faster than any sea that wide: probably km/h or another unit, given as m/s"
        )
        return Verdict((said,)) if usual_m_s > limits[-1][1] else Verdict((), (said,))
    if span >= _SLOW_DEG and usual_m_s < _SLOW_M_S:
        said = (
            f"its water moves at {usual_m_s:.2g} m/s (root mean square over {span:.0f} degrees), "
            "slower than any sea that wide: probably another unit"
        )
        return Verdict((), (said,))
    return Verdict()


def _place_verdict(field: Field, shore: Shore) -> Verdict:
    """Whether the gaps lie where the land is, or would at an offset."""
    found = shifted.shift(field, shore)
    if found is None:
        return Verdict()
    cells = float(np.hypot(found.east / field.cell[0], found.north / field.cell[1]))

    def exceeds(offset: float, count: int, share: float) -> bool:
        return cells >= offset and found.explained >= count and found.share >= share

    said = (
        f"the field is shifted by {_degrees(found.east, 'east', 'west')} and "
        f"{_degrees(found.north, 'north', 'south')}: {found.explained} cells of dry land have "
        "figures that they have not where it is moved back"
    )
    if exceeds(*_SHIFT_CERTAIN):
        return Verdict((said,))
    return Verdict((), (f"perhaps {said}",)) if exceeds(*_SHIFT_DOUBTED) else Verdict()


def _degrees(offset: float, ahead: str, back: str) -> str:
    """Spell an offset: "0.50 degrees west"."""
    return f"{abs(offset):.2f} degrees {ahead if offset >= 0 else back}"


def _direction_verdict(field: Field) -> Verdict:
    """Whether a component has the wrong sign, or the two are swapped."""
    twin = turned.likeliest(field)
    if twin is None or twin.contrast < _CONTRAST or twin.certainty < _DOUBTED:
        return Verdict()
    said = (
        f"{twin.name}: set right, the water would converge and diverge less (by a contrast of "
        f"{twin.contrast:.2f}, {min(twin.certainty, 99):.0f} standard errors)"
    )
    if twin.name != turned.QUARTER and twin.certainty >= _CERTAIN:
        return Verdict((said,))
    waves = ", or it is waves and tides more than currents"
    return Verdict((), (f"perhaps {said}{waves if twin.name == turned.QUARTER else ''}",))


def misplaced(
    field: Field, shore: Shore, bounds: tuple[float, float, float, float] | None = None
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Count gaps in open water and figures far inland, each with the cells that there are.

    Inside `bounds` (west, south, east, north), if not everywhere.
    """
    west, south, east, north = bounds or (-np.inf, -np.inf, np.inf, np.inf)
    inside = ((field.lat >= south) & (field.lat <= north))[:, None]
    inside = inside & ((field.lon >= west) & (field.lon <= east))[None, :]
    is_land = shore.cells(field.lon, field.lat)
    far = max(1, min(FAR_CELLS, round(_FAR_DEG / max(field.cell))))
    open_water = inside & ~grown(is_land, far)
    inland = inside & ~grown(~is_land, far)
    gap = field.gap
    return (
        (int((open_water & gap).sum()), int(open_water.sum())),
        (int((inland & ~gap).sum()), int(inland.sum())),
    )


def grown(cells: BoolArray, by: int, *, at_edge: bool = True) -> BoolArray:
    """Cells within so many of a marked one, or of the grid's edge: outside is not known."""
    from scipy.ndimage import binary_dilation

    square = np.ones((2 * by + 1,) * 2, dtype=bool)
    return np.asarray(binary_dilation(cells, square, border_value=at_edge), dtype=bool)
