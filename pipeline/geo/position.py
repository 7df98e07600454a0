"""A position as text, for messages and reports."""


def position_text(lon: float, lat: float) -> str:
    """Write a position in degrees, by its hemispheres: 119.8710 E 11.5244 N, 70.9815 W 42.3427 N.

    Longitudes of a chart across 180 degrees may be beyond it.
    """
    east = (lon + 180) % 360 - 180
    return f"{abs(east):.4f} {'W' if east < 0 else 'E'} {abs(lat):.4f} {'S' if lat < 0 else 'N'}"
