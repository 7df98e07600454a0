"""Which variables of files are a current: no wind, ice or waves; and a total before its parts."""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from pipeline.model import Note

if TYPE_CHECKING:
    import xarray as xr

# Standard names of eastward components and their partners, and pairs of names for variables without
# a standard name, in the order in which they are preferred.
_STANDARD_NAMES = tuple(
    (name, name.replace("eastward", "northward").replace("_x_", "_y_"))
    for name in (
        "eastward_sea_water_velocity",
        "surface_eastward_sea_water_velocity",
        "eastward_sea_water_velocity_assuming_no_tide",
        "sea_water_x_velocity",
        "surface_sea_water_x_velocity",
        "surface_geostrophic_eastward_sea_water_velocity",
        "geostrophic_eastward_sea_water_velocity",
    )
)
_VARIABLE_NAMES = (
    *(("utotal", "vtotal"), ("uo", "vo"), ("ugos", "vgos"), ("u", "v"), ("water_u", "water_v")),
)
# Attributes that say what a variable is, and words in them: of what is no water, unless water is
# named too; of waves, which are no current unless in a sum; and of what a reader should be told.
_SAYING = ("standard_name", "long_name", "description", "short_name", "GRIB_name", "var_desc")
_NO_WATER, _WATER = r"\b(wind|gust|air|ice|stress|atmospher)", r"\b(water|current)"
_WAVES, _SUM = r"\b(wave|stokes|swell)", r"(\b[uv]tot|\btot_|_tot|total|sum\b|includ|plus\b)|\+"
_TOLD = rf"(?i){_NO_WATER}|{_WAVES}|{_SUM}|tid(e|al)|bottom|floor|averag|barotrop|anomal|ekman"
_WITHOUT = re.compile(r"\b(without|no|not|excluding)\b[^,;()]*")
# Words of water that moves, or of part of it.
_MOVES = rf"velocity|current|drift|tide|stokes|{_SUM}"
_Variable: TypeAlias = tuple[str, str]
_Pair: TypeAlias = tuple[_Variable, _Variable]


def find_pair(datasets: "Sequence[xr.Dataset]") -> tuple[_Pair, tuple[Note, ...]]:
    """Find the two components, (standard name, name) each, with notes; ValueError without a pair.

    Of several pairs a total is taken, or else the first by its standard name, or by its name.
    """
    said = {
        (str(array.attrs.get("standard_name", "")), str(name)): tuple(
            str(array.attrs[key]) for key in _SAYING if array.attrs.get(key)
        )
        for dataset in datasets
        for name, array in dataset.data_vars.items()
        if array.ndim >= 2
    }
    pairs = list(_pairs({of for of, texts in said.items() if not any(map(_is_other, texts))}))
    if not pairs:
        listed = [f"{of[1]} ({'; '.join(said[of]) or 'no standard name'})" for of in sorted(said)]
        raise ValueError(
            f"it has no pair of current components among {', '.join(listed) or 'no variables'}; "
            f"needed are the standard names {' and '.join(_STANDARD_NAMES[0])}, or variables "
            f"called {', '.join(map('/'.join, _VARIABLE_NAMES))}, which nothing calls wind, "
            "ice or waves: give a file of currents, or correct its names"
        )
    text = {of: " ".join((of[1], *texts)).lower() for of, texts in said.items()}
    pair = max(pairs, key=lambda one: bool(re.search(_SUM, text[one[0]])))
    also = {of for of in said if re.search(_MOVES, text[of]) and not re.search(_NO_WATER, text[of])}
    return pair, tuple(_notes(pair, said, sorted({*also, *itertools.chain(*pairs)} - {*pair})))


def _pairs(variables: set[_Variable]) -> Iterator[_Pair]:
    """Find pairs by their standard names and, of variables without one, by their names."""
    for names in (*_STANDARD_NAMES, ("", "")):
        u, v = ({name.lower(): (of, name) for of, name in variables if of == own} for own in names)
        known = [(u[one], v[other]) for one, other in _VARIABLE_NAMES if one in u and other in v]
        if names[0] and len(u) == len(v) == 1:
            known = list(zip(u.values(), v.values(), strict=True))
        if names[0] and u and v and not known:
            listed = ", ".join(sorted(name for _, name in (*u.values(), *v.values())))
            raise ValueError(
                f"several variables are {names[0]} or its partner ({listed}); keep one pair of them"
            )
        yield from known


def _is_other(said: str) -> bool:
    """Whether a name says that something is no current of water."""
    plain = _WITHOUT.sub("", said.lower().replace("_", " "))
    is_dry = re.search(_NO_WATER, plain) and not re.search(_WATER, plain)
    return bool(is_dry or (re.search(_WAVES, plain) and not re.search(_SUM, plain)))


def _notes(
    pair: _Pair, said: Mapping[_Variable, Sequence[str]], also: Sequence[_Variable]
) -> Iterator[Note]:
    """Note what decided for a pair, what it is called, and what kind of current it is."""
    (standard, u), (_, v) = pair
    called = "; ".join(said[pair[0]][bool(standard) :])
    why = {
        "by their names alone, as they have no standard name": not standard,
        f"which the file calls {called!r}": called and (not standard or re.search(_TOLD, called)),
        f"not {', '.join(name for _, name in also)}": also,
        f"as east and north, although {standard} is along a grid's own lines: wrong by the angle "
        "of a turned grid, if it was put on this one without turning them": "_x_" in standard,
    }
    if any(why.values()):
        yield Note.of(
            "pair-taken", u=u, v=v, why=tuple(text for text, holds in why.items() if holds)
        )
    if "geostrophic" in standard or u == "ugos":
        yield Note.of("current-geostrophic")
    elif "no_tide" in standard:
        yield Note.of("current-without-tide")
