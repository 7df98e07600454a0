"""The earth's size, for conversions that need not be exact, and a position on it as text.

Exact lengths are geodesics, by pyproj.
"""

# Mean radius of the earth, m: (2a + b)/3 of the ellipsoid GRS 80, which is WGS 84's to 0.1 mm
# (Moritz, Geodetic Reference System 1980, Journal of Geodesy 74, 2000).
EARTH_RADIUS_M = 6_371_008.8
# Length of a degree of latitude, m: on a sphere of that radius, rounded. On the ellipsoid it is
# 110,574 m at the equator and 111,694 m at the poles, so this is off by at most 0.6 %.
METRES_PER_DEGREE = 111_195.0


def position_text(lon: float, lat: float) -> str:
    """Write a position in degrees, by its hemispheres: 119.8710 E 11.5244 N, 70.9815 W 42.3427 N.

    Longitudes of a chart across 180 degrees may be beyond it.
    """
    east = (lon + 180) % 360 - 180
    return f"{abs(east):.4f} {'W' if east < 0 else 'E'} {abs(lat):.4f} {'S' if lat < 0 else 'N'}"
