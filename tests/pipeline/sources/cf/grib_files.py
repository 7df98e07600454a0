"""GRIB files for tests, by ecCodes."""

from pathlib import Path

import eccodes
import numpy as np
import xarray as xr

from pipeline._types import FloatArray

# Parameters of a current's components, of the wind's, of a current's direction and speed, of waves
# and gusts.
PARAMETERS: dict[str, dict[int, tuple[int, ...]]] = {
    "uo": {1: (49,), 2: (10, 1, 2)},
    "vo": {1: (50,), 2: (10, 1, 3)},
    "u10": {1: (33,), 2: (0, 2, 2)},
    "v10": {1: (34,), 2: (0, 2, 3)},
    "dirc": {1: (47,), 2: (10, 1, 0)},
    "spc": {1: (48,), 2: (10, 1, 1)},
    "swh": {1: (100,), 2: (10, 0, 3)},
    "gust": {1: (180,), 2: (0, 2, 22)},
    "pp1d": {1: (108,), 2: (10, 0, 34)},
}
_KEYS = {1: ("indicatorOfParameter",), 2: ("discipline", "parameterCategory", "parameterNumber")}
_MISSING = 9999.0


def message(
    edition: int,
    name: str,
    lon: FloatArray,
    lat: FloatArray,
    values: FloatArray,
    **keys: float | str,
) -> bytes:
    """Encode a field (ny, nx) on a regular grid; `keys` are set last, in their order.

    Values stand in the order that `jPointsAreConsecutive` and `alternativeRowScanning` say.
    """
    handle = eccodes.codes_grib_new_from_samples(f"regular_ll_sfc_grib{edition}")
    numbers = dict(zip(_KEYS[edition], PARAMETERS[name][edition], strict=True))
    ends = {
        f"{axis}Of{end}GridPointInDegrees": float(nodes[place])
        for axis, nodes in (("longitude", lon), ("latitude", lat))
        for end, place in (("First", 0), ("Last", -1))
    }
    settings = {
        "centre": "kwbc",
        **({"table2Version": 2} if edition == 1 else {}),
        **numbers,
        "Ni": lon.size,
        "Nj": lat.size,
        **ends,
        "iDirectionIncrementInDegrees": abs(float(lon[1] - lon[0])),
        "jDirectionIncrementInDegrees": abs(float(lat[1] - lat[0])),
        "iScansNegatively": int(lon[0] > lon[1]),
        "jScansPositively": int(lat[1] > lat[0]),
        "bitmapPresent": 1,
        "missingValue": _MISSING,
        "bitsPerValue": 24,
        **keys,
    }
    for key, value in settings.items():
        eccodes.codes_set(handle, key, value)
    lines = np.where(np.isnan(values), _MISSING, values)
    if settings.get("jPointsAreConsecutive"):
        lines = lines.T
    if settings.get("alternativeRowScanning"):
        lines = lines.copy()
        lines[1::2] = lines[1::2, ::-1]
    eccodes.codes_set_values(handle, lines.reshape(-1))
    try:
        return bytes(eccodes.codes_get_message(handle))
    finally:
        eccodes.codes_release(handle)


def messages(data: xr.Dataset, edition: int = 1, **keys: float | str) -> list[bytes]:
    """Encode each time of each variable of a dataset along time, latitude and longitude."""
    return [
        message(
            edition,
            str(name),
            data.longitude.values,
            data.latitude.values,
            field.values,
            dataDate=int(field.time.dt.strftime("%Y%m%d")),
            dataTime=int(field.time.dt.strftime("%H%M")),
            **keys,
        )
        for time in range(data.time.size)
        for name, field in data.isel(time=time).data_vars.items()
    ]


def write_grib(path: Path, data: xr.Dataset, edition: int = 1, **keys: float | str) -> Path:
    """Write a dataset as GRIB."""
    path.write_bytes(b"".join(messages(data, edition, **keys)))
    return path
