"""The seasons' colours as people with other colour vision see them."""

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.formats.appearance import (
    COLOURS,
    DARK,
    SEASON_COLOURS,
    SEASON_COLOURS_ON_DARK,
    season_colour,
)

# What is seen, in linear RGB: Machado, Oliveira and Fernandes (2009), severity 1.
VISION = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopia": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
# Linear RGB -> cone responses -> Oklab (Ottosson, 2020).
_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def linear(colour: str) -> NDArray[np.float64]:
    values = np.frombuffer(bytes.fromhex(colour.removeprefix("#")), np.uint8) / 255
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def oklab(colour: str, vision: str) -> NDArray[np.float64]:
    seen = np.clip(VISION[vision] @ linear(colour), 0, 1)
    result: NDArray[np.float64] = _OKLAB @ np.cbrt(_CONES @ seen)
    return result


def contrast(one: str, other: str, vision: str) -> float:
    """Return the contrast of WCAG 2.2 for a colour vision."""
    seen = [np.clip(VISION[vision] @ linear(c), 0, 1) for c in (one, other)]
    dim, bright = sorted(float(one @ [0.2126, 0.7152, 0.0722]) for one in seen)
    return (bright + 0.05) / (dim + 0.05)


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("colours", [SEASON_COLOURS, SEASON_COLOURS_ON_DARK])
def test_seasons_differ_for_every_colour_vision(vision: str, colours: tuple[str, ...]) -> None:
    """The report's former magenta and green were 0.016 apart with deuteranopia."""
    apart = {
        (one, other): float(np.linalg.norm(oklab(one, vision) - oklab(other, vision)))
        for one, other in itertools.combinations(colours, 2)
    }
    assert min(apart.values()) > 0.095
    assert apart[colours[0], colours[1]] > 0.2


# No lines: areas, the faint graticule, the halo below lines, and arrows, whose shades are speeds.
NO_LINES = {"water", "land", "nogo", "shoal", "soft", "turning", "grid", "halo"}


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("ground", ["water", "land", "nogo", "shoal"])
def test_every_line_stands_out_from_land_and_sea(ground: str, vision: str) -> None:
    """WCAG asks for a contrast of 3 between graphics and what is around them."""
    for colours, seasons in ((COLOURS, SEASON_COLOURS), (DARK, SEASON_COLOURS_ON_DARK)):
        roles = {one for one in colours if not one.startswith("speed")} - NO_LINES
        lines = {role: colours[role] for role in roles}
        lines |= {f"season {number}": one for number, one in enumerate(seasons)}
        low = {
            role: colour
            for role, colour in lines.items()
            if contrast(colour, colours[ground], vision) < 3
        }
        assert low == {}


def test_more_seasons_than_colours() -> None:
    assert len(SEASON_COLOURS) == len(SEASON_COLOURS_ON_DARK)
    assert season_colour(0) == season_colour(len(SEASON_COLOURS)) == SEASON_COLOURS[0]
