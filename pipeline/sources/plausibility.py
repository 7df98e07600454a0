"""Plausibility of a current field, whatever its source: its speeds, position and directions.

The thresholds come from real fields: GLO12 (1 degree, January 2024), DUACS (1/4 degree, February
2019), OSCAR (1/3 degree, monthly climatology) and the Central Weather Administration's OCM (1/10
degree, June 2020). Strong evidence is a fault, weak evidence a warning to the reader.

A component may have the wrong sign, or the two may be swapped. At the scales of a grid the sea
rotates far more than it diverges: it is nearly in geostrophic balance, and water does not pile up
for long. With one sign wrong, or with the components swapped, shear and strain appear as
divergence, and divergence as shear and strain. So among the field as it is and its variants, the
right one diverges least. The four combinations of derivatives come from Okubo (1970), the standard
error from a delete-one jackknife over blocks (Efron and Stein 1981). Two wrong signs can't be
detected, as they leave the size of the divergence unchanged. A quarter turn (swapped, and one sign
wrong) is never certain either, as waves and tides diverge more than they rotate. It is taken for
the likeliest variant even if another one diverges a little less. Nothing is judged where all water
moves along one line, as in a strait.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline._types import BoolArray, FloatArray, IndexArray
from pipeline.geo.projection import EARTH_RADIUS_M
from pipeline.model import Note
from pipeline.sources.current_field import Field, LandMask, find_shift
from pipeline.sources.quantities import SIZE, Quantity

# Limits of the root mean square speed of moving water: (least width and height of the field in
# degrees to which the limits apply; speed in m/s above which to warn; above which to refuse). Real
# fields of these widths reach 0.9, 0.75, 0.52 and 0.44 m/s.
_FAST_M_S = ((8.0, 1.0, 1.6), (20.0, 0.8, 1.1), (60.0, 0.6, 0.75), (100.0, 0.5, 0.6))
# Width in degrees from which a field may be too slow.
_SLOW_DEG = 20.0
# Speed below which a field of that width is suspicious, m/s.
_SLOW_M_S = 0.02
# Speed above which a value is a fill value such as -999 or 1e20, m/s.
_FILL_M_S = 900.0
# Variation of the components, as a share of the speed, up to which a field is constant. No real
# field is.
_CONSTANT_SHARE = 1e-6
# Least number of cells by which a field is called constant.
_MIN_CELLS = 20
# Distance from the coast beyond which cells are open water (or inland), in cells. Nearer to it
# models leave out straits and shallows, or have water on land.
OFFSHORE_CELLS = 3
# The same distance in degrees, where that is less.
_OFFSHORE_DEG = 0.75
# Least contrast between divergences that counts.
_MIN_CONTRAST = 0.1
# Least certainty of a contrast, in standard errors, for a warning and for a fault. Of 3000 real
# windows (6 to 24 degrees wide), 3 gave a warning and none a fault.
_WARNING_CERTAINTY = 2.0
_FAULT_CERTAINTY = 4.0
# Least shift for a warning and for a fault: offset in cells, number of land cells that it explains,
# and their share. Real fields reach 11 cells with a share of 0.01 over 120 degrees, and 16 cells
# with a share of 0.6 over 24 degrees.
_SHIFT_WARNING = (0.3, 30, 0.03)
_SHIFT_FAULT = (0.45, 40, 0.12)


@dataclass(frozen=True, slots=True)
class Assessment:
    """Doubts about a field: `faults` refuse it, `warnings` do not."""

    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __add__(self, other: "Assessment") -> "Assessment":
        """Return both assessments together."""
        return Assessment(self.faults + other.faults, self.warnings + other.warnings)

    def doubts(self, source: str) -> tuple[Note, ...]:
        """The warnings about a source's field, for a reader."""
        return tuple(
            Note.of("current-doubtful", source=source, warning=warning) for warning in self.warnings
        )


def assess_speeds(field: Field, limit_m_s: float) -> Assessment:
    """Assess whether the field moves, differs from place to place, and is not too fast."""
    u, v = field.u[~field.gap], field.v[~field.gap]
    speed = np.hypot(u, v)
    if not speed.size:
        return Assessment(("it has no data at all",))
    strongest = float(speed.max())
    if strongest == 0:
        return Assessment(("every speed is 0",))
    if strongest > limit_m_s:
        cause = "a fill value" if strongest > _FILL_M_S else "another unit"
        fault = f"speeds reach {strongest:.3g} m/s, above {limit_m_s:g}: {cause}, or damaged"
        return Assessment((fault,))
    if u.size >= _MIN_CELLS and max(np.ptp(u), np.ptp(v)) <= _CONSTANT_SHARE * strongest:
        return Assessment((f"it is the same everywhere ({u[0]:.3g} east, {v[0]:.3g} m/s north)",))
    return _assess_unit(field, float(np.sqrt(np.mean(speed[speed > 0] ** 2))))


def _assess_unit(field: Field, rms_m_s: float) -> Assessment:
    """Assess whether the speeds seem to be in another unit: 3.6 km/h are 1 m/s."""
    span = min(float(np.ptp(field.lon)), float(np.ptp(field.lat)))
    limits = [limits for width, *limits in _FAST_M_S if span >= width]
    if limits and rms_m_s > limits[-1][0]:
        message = (
            f"its water moves at {rms_m_s:.2g} m/s (root mean square over {span:.0f} degrees), "
            "faster than any sea of that width: probably km/h or another unit, given as m/s"
        )
        is_fault = rms_m_s > limits[-1][1]
        return Assessment((message,)) if is_fault else Assessment((), (message,))
    if span >= _SLOW_DEG and rms_m_s < _SLOW_M_S:
        message = (
            f"its water moves at {rms_m_s:.2g} m/s (root mean square over {span:.0f} degrees), "
            "slower than any sea of that width: probably another unit"
        )
        return Assessment((), (message,))
    return Assessment()


def assess_position(field: Field, mask: LandMask) -> Assessment:
    """Assess whether the gaps lie where the land is, or would at an offset."""
    shift = find_shift(field, mask)
    if shift is None:
        return Assessment()
    east, north, explained, land_cells = shift
    cells = float(np.hypot(east / field.cell_deg[0], north / field.cell_deg[1]))

    def exceeds(offset: float, count: int, share: float) -> bool:
        return cells >= offset and explained >= count and explained >= share * max(land_cells, 1)

    message = (
        f"the field is shifted by {abs(east):.2f} degrees {'east' if east >= 0 else 'west'} and "
        f"{abs(north):.2f} degrees {'north' if north >= 0 else 'south'}: {explained} cells of dry "
        "land have data that they would not have if it were moved back"
    )
    if exceeds(*_SHIFT_FAULT):
        return Assessment((message,))
    return Assessment((), (f"perhaps {message}",)) if exceeds(*_SHIFT_WARNING) else Assessment()


def assess_directions(field: Field) -> Assessment:
    """Assess whether a component has the wrong sign, or the two are swapped."""
    name, contrast, certainty = likeliest_variant(field) or ("", 0.0, 0.0)
    if contrast < _MIN_CONTRAST or certainty < _WARNING_CERTAINTY:
        return Assessment()
    message = f"{name}: corrected, the water would converge and diverge less"
    if name == ROTATED:
        waves = ", or it is waves and tides more than currents"
        return Assessment((), (f"perhaps {message}{waves}",))
    message += f" (contrast {contrast:.2f}, {certainty:.0f} standard errors)"
    if certainty >= _FAULT_CERTAINTY:
        return Assessment((message,))
    return Assessment((), (f"perhaps {message}",))


def count_misplaced(
    field: Field, mask: LandMask, bounds: tuple[float, float, float, float] | None = None
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Count gaps among the cells of open water, and cells with data among all cells far inland.

    Only cells inside `bounds` (west, south, east, north) count, where these are given.
    """
    west, south, east, north = bounds or (-np.inf, -np.inf, np.inf, np.inf)
    inside = ((field.lat >= south) & (field.lat <= north))[:, None]
    inside = inside & ((field.lon >= west) & (field.lon <= east))[None, :]
    is_land = mask.on_grid(field.lon, field.lat)
    distance = max(1, min(OFFSHORE_CELLS, round(_OFFSHORE_DEG / max(field.cell_deg))))
    open_water = inside & ~dilated(is_land, distance)
    inland = inside & ~dilated(~is_land, distance)
    gap = field.gap
    return (
        (int((open_water & gap).sum()), int(open_water.sum())),
        (int((inland & ~gap).sum()), int(inland.sum())),
    )


def dilated(cells: BoolArray, distance: int, *, edge_counts: bool = True) -> BoolArray:
    """Return the cells within a distance of a marked one or, by default, of the edge."""
    from scipy.ndimage import binary_dilation

    square = np.ones((2 * distance + 1,) * 2, dtype=bool)
    return np.asarray(binary_dilation(cells, square, border_value=edge_counts), dtype=bool)


# Largest number of times that a message names.
_MAX_TIMES = 3


def assess_series(
    fields: Iterable[Field], labels: Sequence[str], mask: LandMask, limit_m_s: float
) -> Assessment:
    """Assess the speeds and directions of fields on one grid, and the first one's position.

    Fields are taken one after the other, as all of them may not fit in memory. `labels` are their
    times as text, which are not used for a single field.
    """
    first: Field | None = None
    speeds: list[Assessment] = []
    directions: list[Assessment] = []
    for field in fields:
        first = first or field
        speeds.append(assess_speeds(field, limit_m_s))
        directions.append(Assessment() if speeds[-1].faults else assess_directions(field))
    assessment = _at_times(speeds, labels)
    if first is not None and not assessment.faults:
        assessment += assess_position(first, mask)
        # Water that is just turning may look as if it ran the wrong way: a doubt about directions
        # counts if it arises at more than half of the times.
        wrong = [doubt for doubt in directions if doubt.faults]
        doubtful = [doubt for doubt in directions if doubt.warnings]
        for doubts in (wrong, doubtful):
            if 2 * len(doubts) > len(directions):
                assessment += doubts[0]
                break
    return assessment


def assess_sizes(fields: Iterable[Field], labels: Sequence[str], quantity: Quantity) -> Assessment:
    """Assess whether fields of wind or waves have values, and none that can't be."""
    each = list[Assessment]()
    for field in fields:
        size = np.hypot(field.u, field.v)[~field.gap]
        most = float(size.max(initial=0.0))
        low = 0.0
        if SIZE in quantity.grib_names:  # it has no direction
            low = float(field.u.min(where=~field.gap, initial=0.0))
        fault = f"it reaches {most:.3g} {quantity.unit}, above {quantity.most:g}"
        if low < 0:
            fault = f"it falls to {low:.3g} {quantity.unit}"
        is_wrong = low < 0 or most > quantity.most
        faults = (f"{fault}: a fill value, another unit, or damaged",) if is_wrong else ()
        each.append(Assessment(faults if size.size else ("it has no data at all",)))
    return _at_times(each, labels)


def _at_times(each: Sequence[Assessment], labels: Sequence[str]) -> Assessment:
    """Join the doubts about the fields of some times, each with its time."""
    if len(each) == 1:
        return each[0]
    times = list(zip(each, labels, strict=True))
    faults = [f"at {label} {fault}" for assessment, label in times for fault in assessment.faults]
    warnings = [f"at {label} {one}" for assessment, label in times for one in assessment.warnings]
    return Assessment(_first_few(faults), _first_few(warnings))


def _first_few(messages: Sequence[str]) -> tuple[str, ...]:
    """Return the first messages, and how many more there are."""
    more = len(messages) - _MAX_TIMES
    return (*messages[:_MAX_TIMES], *([f"and so at {more} more of its times"] if more > 0 else []))


# Blocks per side that the grid is divided into for the standard error.
_BLOCKS_PER_SIDE = 6
# Least number of blocks with moving water: with fewer the standard error means nothing.
_MIN_BLOCKS = 8
# A quarter turn counts as the likeliest variant if its divergence is at most this multiple of the
# least one; in real fields it is 1.5 times the least one.
_TIE = 1.2
# Ratio of the squared speeds across and along the main direction up to which all water moves along
# one line. Real fields have 0.12.
_STRAIGHT_SHARE = 0.05
# Least number of corners between four cells of moving water.
_MIN_CORNERS = 40


FLIPPED = "one component has the wrong sign"
SWAPPED = "the components are swapped"
ROTATED = "the components are swapped and one has the wrong sign"


def likeliest_variant(field: Field) -> tuple[str, float, float] | None:
    """Return which mixing up of the components is likeliest, its contrast, and its certainty.

    It is the variant that diverges least; None if that is the field itself, or if data are few. The
    contrast is (own - variant) / (own + variant) of the squared divergences, -1 to 1. The certainty
    is the contrast in its standard errors.
    """
    own = _divergence(field, field.u, field.v) ** 2
    velocities = np.stack([field.u[~field.gap], field.v[~field.gap]])
    across, along = np.linalg.eigvalsh(velocities @ velocities.T)
    moving = np.isfinite(own) & (_variation(field) > 0)
    if np.count_nonzero(moving) < _MIN_CORNERS or across <= _STRAIGHT_SHARE * along:
        return None
    row, column = (np.arange(size) * _BLOCKS_PER_SIDE // size for size in own.shape)
    block = (row[:, None] * _BLOCKS_PER_SIDE + column)[moving]
    candidates = {
        FLIPPED: (-field.u, field.v),
        SWAPPED: (field.v, field.u),
        ROTATED: (field.v, -field.u),
    }
    sums = {
        name: _block_sums(block, (_divergence(field, *uv) ** 2)[moving])
        for name, uv in candidates.items()
    }
    own_sums = _block_sums(block, own[moving])
    name = min(sums, key=lambda name: float(sums[name].sum()))
    if sums[ROTATED].sum() <= _TIE * sums[name].sum():
        name = ROTATED
    if sums[name].sum() >= own_sums.sum():
        return None
    used = own_sums + sums[name] > 0
    difference, total = (own_sums - sums[name])[used], (own_sums + sums[name])[used]
    count = len(total)
    if count < _MIN_BLOCKS:
        return None
    contrast = float(difference.sum() / total.sum())
    without_one = (difference.sum() - difference) / (total.sum() - total)
    error = np.sqrt((count - 1) / count * np.square(without_one - without_one.mean()).sum())
    return name, contrast, contrast / max(float(error), 1e-9)


def _divergence(field: Field, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the divergence (ny - 1, nx - 1), 1/s, at corners between cells; NaN beside land."""
    cosine = np.cos(np.radians(field.lat))[:, None]
    middle = (cosine[1:] + cosine[:-1]) / 2
    east = (u[1:, 1:] + u[:-1, 1:] - u[1:, :-1] - u[:-1, :-1]) / 2
    through = v * cosine
    north = (through[1:, 1:] + through[1:, :-1] - through[:-1, 1:] - through[:-1, :-1]) / 2
    dx = np.radians(np.diff(field.lon))[None, :]
    dy = np.radians(np.diff(field.lat))[:, None]
    return np.asarray((east / dx + north / dy) / (EARTH_RADIUS_M * middle))


def _block_sums(block: IndexArray, values: FloatArray) -> FloatArray:
    """Return the sum of the values in each block (n,)."""
    return np.asarray(np.bincount(block, values, _BLOCKS_PER_SIDE**2), dtype=float)


def _variation(field: Field) -> FloatArray:
    """Return squared differences (ny - 1, nx - 1) of cells around a corner: 0 in still water."""
    total = np.zeros((field.lat.size - 1, field.lon.size - 1))
    for part in (field.u, field.v):
        for other in (part[1:, 1:], part[1:, :-1], part[:-1, 1:]):
            total += (other - part[:-1, :-1]) ** 2
    return total
