"""Opening the user's files of currents, NetCDF or Zarr: damage gets one line, sizes are limited.

The libraries below raise errors of many kinds about damaged files, and read as much as a file
declares. So each call of them is made here or inside `reading`, and sizes are checked before.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline._types import FloatArray
from pipeline.sources.currents.cf.classic_format import MAGIC, missing_bytes

if TYPE_CHECKING:
    import xarray as xr

# First bytes of a NetCDF 4 file.
_HDF5 = b"\x89HDF"
# Files that make a folder a Zarr store.
_ZARR_MARKERS = ("zarr.json", ".zgroup", ".zmetadata")
# Largest number of values of an axis: 57 years of hours, or cells of 80 m round the world.
_MAX_AXIS = 500_000
# Largest size of a chunk, bytes: one value of it can't be read without all of it.
_MAX_CHUNK_BYTES = 512 << 20
# Kinds of NumPy types that are numbers, and those that are text.
_NUMBERS, _TEXT = "iuf", "SUO"
# Length to which a message of a library is cut, characters.
_MAX_REASON = 200


def is_zarr(path: Path) -> bool:
    """Whether a path is that of a Zarr store."""
    return path.is_dir() and any((path / name).is_file() for name in _ZARR_MARKERS)


def is_hdf5(path: Path) -> bool:
    """Whether a file says that it is NetCDF 4, and so HDF5."""
    try:
        with path.open("rb") as file:
            return file.read(4) == _HDF5
    except OSError:
        return False


@contextlib.contextmanager
def reading() -> Iterator[None]:
    """Turn what libraries raise about a file into a ValueError."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        # Doubts of the libraries about attributes; the values are checked themselves.
        warnings.simplefilter("ignore")
        try:
            yield
        except Exception as error:  # noqa: BLE001 - any kind, from five libraries
            reason = " ".join(str(error).split()) or type(error).__name__
            if len(reason) > _MAX_REASON:
                reason = f"{reason[:_MAX_REASON]}…"
            raise ValueError(f"it can't be read: {reason}; fetch it again") from None


def open_dataset(path: Path) -> xr.Dataset:
    """Open a file without reading values or decoding times; ValueError where that fails.

    Attributes of variables become text, as damaged ones may be anything.
    """
    import xarray as xr

    with reading():
        store = _store(path)
    if store is None:
        raise ValueError("it is neither NetCDF nor Zarr; convert it, as with `cdo -f nc copy`")
    try:
        with reading():
            sizes = {
                str(name): variable.size
                for name, variable in store.get_variables().items()
                if tuple(variable.dims) == (name,)
            }
        for name, size in sizes.items():
            _check_axis_size(name, size)
        with reading():
            dataset = xr.open_dataset(store, decode_times=False, decode_timedelta=False)
    except ValueError:
        store.close()
        raise
    for variable in dataset.variables.values():
        variable.attrs = {str(key): str(value) for key, value in variable.attrs.items()}
    return dataset


def _store(path: Path) -> Any:  # noqa: ANN401 - xarray does not say what a store's type is
    """Open a file's store; None where it is neither NetCDF nor Zarr."""
    if is_zarr(path):
        from xarray.backends import ZarrStore

        return ZarrStore.open_group(path, consolidated=False)
    if path.is_file():
        with path.open("rb") as file:
            magic = file.read(4)
        if magic.startswith(MAGIC) and (missing := missing_bytes(path)):
            raise ValueError(f"it ends {missing:,} bytes before its last value")
        if magic.startswith((_HDF5, MAGIC)):
            from xarray.backends import NetCDF4DataStore

            return NetCDF4DataStore.open(str(path))  # type: ignore[no-untyped-call]
    return None


def groups_of(path: Path) -> tuple[str, ...]:
    """Return the names of a NetCDF file's groups, whose variables are not read."""
    if is_zarr(path):
        return ()
    import netCDF4

    with reading(), netCDF4.Dataset(path) as dataset:
        return tuple(dataset.groups)


def coordinate_values(dataset: xr.Dataset, name: str) -> FloatArray:
    """Read a coordinate, or its bounds, as numbers; ValueError where it is something else."""
    variable = dataset.variables[name]
    _check_axis_size(name, variable.size)
    check_is_number(name, variable)
    with reading():
        return np.asarray(variable.values, dtype=float)


def check_is_number(name: str, variable: xr.Variable | xr.DataArray) -> None:
    """Refuse a variable that holds text or anything else that is no number."""
    if variable.dtype.kind not in _NUMBERS:
        kind = "text" if variable.dtype.kind in _TEXT else "another type"
        raise ValueError(f"{name} holds {kind}, not numbers; give it as numbers")


def check_chunks(array: xr.DataArray) -> None:
    """Refuse a variable whose chunks do not fit in memory."""
    chunks = array.encoding.get("chunksizes") or array.encoding.get("chunks") or ()
    size = math.prod(map(int, chunks)) * array.dtype.itemsize
    if size > _MAX_CHUNK_BYTES:
        raise ValueError(
            f"{array.name} is stored in chunks of {size >> 20:,} MB, above "
            f"{_MAX_CHUNK_BYTES >> 20}; divide them, as with `nccopy -c`"
        )


def _check_axis_size(name: str, size: int) -> None:
    """Refuse an axis that has more values than any real one."""
    if size > _MAX_AXIS:
        raise ValueError(
            f"{name} has {size:,} values, more than {_MAX_AXIS:,}; cut out the region and the time"
        )
