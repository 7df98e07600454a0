"""Largest rate λ, per second, at which a function of the place can grow on a vessel's way.

Let p = ∇u be the gradient of the function u, T the unit tangent of the way, and c the current. With
g the speed over ground, u grows by (p·T) g a second. Where the vessel chooses its speed v, a second
costs (vᵏ + μ) over the polar's scale (:mod:`renew.kernels.ground_speed`), and λ is the largest
growth divided by this cost:

- crab: in any direction T the growth is at most v |p| + p·c. Growth divided by cost is largest at
  the v that would be best if there were no cross-current.
- projected: the largest growth over all T is a convex function of v, and so lies below its chords.
  The range of speeds is cut into a few pieces, and on each piece the chord replaces the function.
"""

import math

from renew._compiled import kernel
from renew._types import FloatArray
from renew.kernels.ground_speed import Polar, ground_speed

# Share by which a rate is raised for rounding.
_ROUNDING = 1e-6
# Number of pieces into which a range of speeds is cut.
_PIECES = 8


@kernel
def growth_rate(
    px: float,
    py: float,
    corner_currents: FloatArray,
    deviation: float,
    polar: Polar,
) -> float:
    """λ of a triangle: an upper bound on (p·T) g over all T and all its points; p in s/m."""
    p = math.sqrt(px * px + py * py)
    largest = -math.inf
    for k in range(3):
        cx, cy = corner_currents[k]
        if polar.least < polar.speed:
            rate = _rate_at_choice(px, py, cx, cy, deviation, polar)
        elif polar.crab:
            rate = polar.speed * p + px * cx + py * cy
        else:
            rate = projected_rate(px, py, cx, cy, polar.speed, largest)
        largest = max(largest, rate)
    return largest if polar.least < polar.speed else largest + deviation * p


@kernel
def projected_rate(
    px: float, py: float, cx: float, cy: float, speed: float, enough: float = -math.inf
) -> float:
    """Upper bound, nearly attained, on (p·T)(v + c·T) over unit T; p in s/m.

    The Lagrange dual of a quadratic on the unit circle: with w = (v |p|/2)² and the quadratic
    form's eigenvalues e, e' = (p·c ± |p||c|)/2, every μ > e gives the bound
    μ + w μ / ((μ - e)(μ - e')). The bound is least where (μ - e)(μ - e') = √w √(μ² - e e').
    Newton's iteration approaches this μ from the right. The bound holds wherever the iteration
    stops. At the end it is raised by more than rounding can have lowered it.
    """
    p = math.sqrt(px * px + py * py)
    if p == 0.0:
        return 0.0
    dot, product = px * cx + py * cy, p * math.sqrt(cx * cx + cy * cy)
    top, bottom = (dot + product) / 2, (dot - product) / 2
    root = speed * p / 2
    mu = top + root
    least = mu + root * root * mu / ((mu - top) * (mu - bottom))
    for _ in range(6):
        side = math.sqrt(max(mu * mu - top * bottom, 0.0))
        if side == 0.0:
            break
        residual = (mu - top) * (mu - bottom) - root * side
        slope = 2 * mu - top - bottom - root * mu / side
        following = mu - residual / slope if slope > 0.0 else top
        mu = following if following > top else (mu + top) / 2
        # Closer to the eigenvalue the bound drowns in rounding.
        if mu - top <= _ROUNDING * (mu + abs(bottom)):
            break
        bound = mu + root * root * mu / ((mu - top) * (mu - bottom))
        if bound >= least * (1 - 1e-7) or bound * (1 + _ROUNDING) <= enough:
            return min(bound, least) * (1 + _ROUNDING)
        least = bound
    return least * (1 + _ROUNDING)


@kernel
def _rate_at_choice(
    px: float, py: float, cx: float, cy: float, deviation: float, polar: Polar
) -> float:
    """λ in a current that may be off by a deviation (m/s), over all speeds that may be chosen."""
    p = math.sqrt(px * px + py * py)
    if p == 0.0:
        return 0.0
    if polar.crab:
        along = (px * cx + py * cy) / p + deviation
        return p * _most_made(along, polar.least, polar.speed, polar)
    step = (polar.speed / polar.least) ** (1.0 / _PIECES)
    low, at_low, largest = polar.least, 0.0, 0.0
    at_low = projected_rate(px, py, cx, cy, low) + deviation * p
    for piece in range(_PIECES):
        high = polar.speed if piece == _PIECES - 1 else low * step
        at_high = projected_rate(px, py, cx, cy, high) + deviation * p
        slope = (at_high - at_low) / (high - low)
        if slope > 0.0:
            rate = slope * _most_made(at_low / slope - low, low, high, polar)
        else:
            rate = polar.scale * at_low / (low**polar.exponent + polar.price)
        largest = max(largest, rate)
        low, at_low = high, at_high
    return largest


@kernel
def _most_made(along: float, low: float, high: float, polar: Polar) -> float:
    """Largest value of scale * (v + along) / (vᵏ + μ), with v from `low` to `high` (m/s)."""
    no_crab = False
    piece = Polar(high, no_crab, low, polar.price, polar.exponent, polar.scale, polar.still, 0.0)
    return ground_speed(along, 0.0, 1.0, 0.0, piece) * (1 + _ROUNDING)
