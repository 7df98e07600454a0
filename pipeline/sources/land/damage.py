"""Damaged and hostile charts: what libraries raise about a user's file becomes one line.

GDAL's drivers that would do what a file says, instead of only reading it, are not used.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from types import ModuleType

from pipeline.errors import PipelineError, RequestError

# Largest longitude and latitude, degrees: half a turn beyond either way of counting, and rounding.
MAX_LONLAT = (540.0, 90.01)
# Names of GDAL's own functions, which open some of its messages.
_FUNCTION = re.compile(r"\bOGR\w+\(\): ")
# Ends of GDAL's messages that are about its own options.
_ADVICE = re.compile(r"(\.; It might help|\. To avoid accepting|\. Further messages).*|\.$")
# Warnings on what does not matter for land: measures along lines, and numbers of features.
_HARMLESS = re.compile(r"Measured \(M\) geometry types|Several features with id")
# Length to which a message of a library is cut, characters.
_MAX_REASON = 200


# GDAL's drivers that take what a file holds for a command: to read other files or addresses, to
# start a program, or to load a library.
_FOLLOWERS = (
    *("ADBC", "AmigoCloud", "Carto", "CSW", "EEDA", "Elasticsearch", "GDALG", "GPSBabel", "HTTP"),
    *("NGW", "OAPIF", "OGCAPI", "OGR_VRT", "PLSCENES", "VRT", "WFS"),
)


@cache
def vector_library() -> ModuleType:
    """Import pyogrio, and take from GDAL the drivers that follow what a file says."""
    pyogrio = import_module("pyogrio")
    from pyogrio._ogr import _register_drivers  # it has no public function for this

    # GDAL looks at this option when it registers its drivers, which importing pyogrio does.
    pyogrio.set_gdal_config_options({"GDAL_SKIP": ",".join(_FOLLOWERS)})
    _register_drivers()
    return pyogrio


@contextmanager
def reading(what: str, remedy: str) -> Iterator[list[str]]:
    """Turn what libraries raise about a file into a RequestError, and list their warnings.

    They raise errors of many kinds about damaged files; the text of each states what is wrong.
    """
    issued: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield issued
        except PipelineError:
            raise
        except Exception as error:
            fault = f"{what} can't be read ({one_line(error)}); {remedy}"
            raise RequestError([fault]) from error
        finally:
            said = dict.fromkeys(one_line(warning.message) for warning in caught)
            issued += [text for text in said if not _HARMLESS.match(text)]


def one_line(message: object) -> str:
    """Write a library's message in one line, without its own functions and options."""
    text = _ADVICE.sub("", _FUNCTION.sub("", " ".join(str(message).split())))
    return text if len(text) <= _MAX_REASON else f"{text[:_MAX_REASON]}…"
