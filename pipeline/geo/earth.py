"""Size of the earth, for conversions that need not be exact; exact lengths are geodesics."""

# Mean radius of the earth, m: (2a + b)/3 of the ellipsoid GRS 80, which is WGS 84's to 0.1 mm
# (Moritz, Geodetic Reference System 1980, Journal of Geodesy 74, 2000).
EARTH_RADIUS_M = 6_371_008.8
# Length of a degree of latitude, m: on a sphere of that radius, rounded. On the ellipsoid it is
# 110,574 m at the equator and 111,694 m at the poles, so this is off by at most 0.6 %.
METRES_PER_DEGREE = 111_195.0
