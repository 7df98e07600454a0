"""Positions as people paste them: forms that others publish, each with its source.

The figures beside a form are those of its source, or are worked out by hand from its degrees,
minutes and seconds.
"""

import pytest

from pipeline.voyage.positions import read_position
from pipeline.voyage.readers import speed_m_s

GOOGLE = "support.google.com/maps/answer/18539"
LATLON = "docs.rs/latlon"
PARSER = "pypi.org/project/lat-lon-parser"
HEX = "hexdocs.pm/latlong"
ESRI = "developers.arcgis.com, CoordinateFormatter.fromLatitudeLongitude"
ISO = "ISO 6709:1983, examples of wikipedia.org/wiki/ISO_6709"
ISO_2008 = "ISO 6709:2008, Annex D, wikipedia.org/wiki/ISO_6709"
NMEA = "NMEA 0183, GGA of gpsd.gitlab.io/gpsd/NMEA.html"
ICAO = "ICAO Doc 4444, flight plan, item 15"
ADMIRALTY = "Admiralty Notices to Mariners"
NGA = "msi.nga.mil, HYDROLANT warnings"
OSM = "wiki.openstreetmap.org/wiki/Browsing"
GEO_COORDINATES = "github.com/ianengelbrecht/geo-coordinates-parser"
THREAD = "threads of users of a map program"
# Degrees of one minute and of one second.
M, S = 1 / 60, 1 / 3600

READ = [
    ("41°24'12.2\"N 2°10'26.5\"E", 2.1740278, 41.4033889, GOOGLE),
    ("41 24.2028 N, 2 10.4418 E", 2.17403, 41.40338, GOOGLE),
    (
        (
            "https://www.google.com/maps/place/41%C2%B024'12.2%22N+2%C2%B010'26.5%22E/@41.4033889,"
            "2.1714475,17z/data=!3m1!4b1!4m4!3m3!8m2!3d41.4033889!4d2.1740278"
        ),
        2.1740278,
        41.4033889,
        GOOGLE,
    ),
    ("https://www.google.com/maps/@54.3200,10.1500,12z", 10.15, 54.32, GOOGLE),
    (
        "https://www.google.com/maps/search/?api=1&query=47.5951518%2C-122.3316393",
        -122.3316393,
        47.5951518,
        "developers.google.com/maps/documentation/urls",
    ),
    ("41%C2%B024'12.2%22N+2%C2%B010'26.5%22E", 2.1740278, 41.4033889, GOOGLE),
    ("https://maps.apple.com/?ll=50.894967,4.341626", 4.341626, 50.894967, "Apple Map Links"),
    ("https://www.openstreetmap.org/#map=15/51.5113/-0.1152", -0.1152, 51.5113, OSM),
    ("https://www.openstreetmap.org/?mlat=51.5113&mlon=-0.1152", -0.1152, 51.5113, OSM),
    ("40° 26' 46\" N 79° 58' 56\" W", -79.98222, 40.44611, LATLON),
    ("N 40° 26′ 46″ W 79° 58′ 56″", -79.98222, 40.44611, LATLON),
    ("40° 26.767' N 79° 58.933' W", -79.98222, 40.44612, LATLON),
    ("N 50°5.30385', E 14°26.94732'", 14.449122, 50.0883975, LATLON),
    ("40.446° N 79.982° W", -79.982, 40.446, LATLON),
    ("N 40.446° W 79.982°", -79.982, 40.446, LATLON),
    ("40° 26′ 46″ N;79° 58′ 56″ W", -79.98222, 40.44611, LATLON),
    ("23.43 North 45.21 West", -45.21, 23.43, PARSER),
    ("23 25.800' N, 45 12.600' W", -45.21, 23.43, PARSER),
    ("23d 25' 48.0\" N, 45d 12' 36.0\" W", -45.21, 23.43, PARSER),
    ("23° 25' 48.0\" North 45° 12' 36.0\" West", -45.21, 23.43, PARSER),
    ("38° 53’ 51.635” N, 77° 2’ 11.507” W", -77.0365297, 38.8976764, HEX),
    ("S17 33 08.352, W69 01 29.74", -69.0249278, -17.5523200, HEX),
    ("N41 25.117, W120 58.292", -120.971533, 41.418617, HEX),
    ("41 25N, 120 58W", -120.966667, 41.416667, HEX),
    ("41°N, 120°W", -120, 41, HEX),
    ("N41.092, W120.8362", -120.8362, 41.092, HEX),
    ("55 56 39.123N 003 09 43.034W", -3.16195389, 55.94420083, ESRI),
    ("55°56′39″N 3°09′43″W", -3.161944, 55.944167, ESRI),
    ("40-26-46N | 079-58-56W", -79.98222, 40.44611, ESRI),
    ("+275916+0865640+8850/", 86 + 56 * M + 40 * S, 27 + 59 * M + 16 * S, ISO),
    ("+48.8577+002.295/", 2.295, 48.8577, ISO),
    ("+4852+00220/", 2 + 20 * M, 48 + 52 * M, ISO),
    ("-90+000+2800/", 0, -90, ISO),
    ("+40.6894-074.0447/", -74.0447, 40.6894, ISO),
    ("+27.5916+086.5640+8850CRSWGS_84/", 86.564, 27.5916, ISO),
    ("50°40′46,461″N 95°48′26,533″W", -95.80737028, 50.67957250, ISO_2008),
    ("50°03′46.461″S 125°48′26.533″E", 125.80737028, -50.06290583, ISO_2008),
    ("geo:13.4125,103.8667", 103.8667, 13.4125, "RFC 5870, 1"),
    ("geo:48.201,16.3695,183;crs=wgs84;u=40", 16.3695, 48.201, "RFC 5870, 6"),
    ("POINT(-122.349 47.651)", -122.349, 47.651, "OGC 06-103r4, well-known text"),
    ("POINT Z (10 54.5 -3)", 10, 54.5, "OGC 06-103r4, well-known text"),
    ("SRID=4326;POINT(-44.3 60.1)", -44.3, 60.1, "postgis.net, ST_GeomFromEWKT"),
    ('{"type": "Point", "coordinates": [100.0, 0.0]}', 100, 0, "RFC 7946, A.1"),
    ('{"lat": -25.344, "lng": 131.031}', 131.031, -25.344, "Maps JavaScript API, LatLngLiteral"),
    ("4807.038,N,01131.000,E", 11 + 31 * M, 48 + 7.038 * M, NMEA),
    ("4620N07805W", -(78 + 5 * M), 46 + 20 * M, ICAO),
    ("463045N0781520W", -(78 + 15 * M + 20 * S), 46 + 30 * M + 45 * S, ICAO),
    ("50° 43'·25N., 1° 17'·80W.", -(1 + 17.8 * M), 50 + 43.25 * M, ADMIRALTY),
    ("36-58.7N 122-02.1W", -(122 + 2.1 * M), 36 + 58.7 * M, NGA),
    ("27deg 15min 45.2sec S 18deg 32min 53.7sec E", 18.548250, -27.262556, GEO_COORDINATES),
    ("17° 30.5340' S - 149° 34.5369' W", -149.575615, -17.5089, THREAD),
    ("54:19:12N 10:09:00E", 10.15, 54.32, THREAD),
    ("[10.15, -54.32]", 10.15, -54.32, THREAD),
    ("24 36.0'N\n81 36.0'W", -81.6, 24.6, "sailblogs.com, wiki, format"),
    ("42 47.269' N 71 3.5' W", -71.058333, 42.787817, "Raymarine, waypoints"),
    ("S33 45 15 E18 30 45", 18.5125, -33.754167, "blog.xplorer.co.za, 2019-01-17"),
    ("41 deg 24' 12.20\" N, 2 deg 10' 26.50\" E", 2.1740278, 41.4033889, "exiftool, GPSPosition"),
    ("12d48m00sN 120d18m00sE", 120.3, 12.8, "aa.usno.navy.mil, forms"),
    ("12d48'N 120d18'E", 120.3, 12.8, "proj.org, cs2cs"),
    ("Lat: 12° 48' N, Long: 120° 18' E", 120.3, 12.8, THREAD),
    ("lat=12.8&lon=-120.3", -120.3, 12.8, "addresses of weather services"),
    ("Longitude 23.6 Latitude -37.9", 23.6, -37.9, THREAD),
    ("S 17.50890 / W 149.57562", -149.57562, -17.5089, THREAD),
    ("12,8°N 120,3°E", 120.3, 12.8, "decimal commas of continental Europe"),
    ("Nord 54° 19,2' / Ost 10° 9,0'", 10.15, 54.32, "threads in German"),
    ("54° 19,2' nord, 10° 9,0' est", 10.15, 54.32, "threads in French and Italian"),
]
# What can be meant in two ways, or is no longitude and latitude, is asked about.
REFUSED = [
    ("12 1/2 N 120 E", "has a fraction; give decimals", "pilot books"),
    ("48°51'N 2°21'O", "east .Ost. in German", "threads in French and German"),
    ("N 54° 19.2' O 10° 9.0'", "east .Ost. in German", "threads in German"),
    ("-23.3245° S / 28.2344° E", "both a sign and S", GEO_COORDINATES),
    ("-81 36.0'W 24 36.0'N", "both a sign and W", "sailblogs.com, wiki, format"),
    ("12 N 48 120 E 18", "E among its figures", "a slip"),
    ("39.1371°E, 88.65°W", "one of N and S", HEX),
    ("33UXP04", "is not a position", "MGRS, wikipedia.org"),
    ("11S 481868 3768515", "one of N and S", "UTM, pro.arcgis.com"),
    ("8FW4V75V+8Q", "is not a position", "plus code, plus.codes"),
    ("///filled.count.soap", "is not a position", "what3words.com"),
    ("https://goo.gl/maps/abc123", "is not a position", "a short link"),
    (
        "https://www.google.com/maps/place/Kiel/@54.3227,10.1356,12z",
        "is not a position",
        "a place's page, whose middle is beside the place",
    ),
]


@pytest.mark.parametrize(("text", "lon", "lat"), [one[:3] for one in READ])
def test_a_published_form_is_read_as_its_source_means_it(text: str, lon: float, lat: float) -> None:
    position = read_position(text)
    # About half a metre: sources round to a tenth of a second.
    assert (position.lon, position.lat) == pytest.approx((lon, lat), abs=6e-6)
    assert not position.either_order or text.startswith("[")


@pytest.mark.parametrize(("text", "why"), [one[:2] for one in REFUSED])
def test_what_has_two_meanings_is_asked_about(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        read_position(text)


@pytest.mark.parametrize("text", ["50.06773, 14.37742", "41.40338, 2.17403", "31 24.20, 12 10.44"])
def test_a_plain_pair_that_may_be_either_is_said(text: str) -> None:
    """Search fields of maps take the latitude first, files of geometry the longitude."""
    position = read_position(text)
    assert position.either_order
    assert "write N or S and E or W" in position.note


def test_the_forms_are_as_many_as_asked() -> None:
    assert len(READ) + len(REFUSED) >= 60
    assert len(READ) >= 45
    assert len({one[0] for one in READ + REFUSED}) == len(READ) + len(REFUSED)


def test_miles_an_hour_are_statute_miles() -> None:
    assert speed_m_s("14mph") == pytest.approx(6.25856)
