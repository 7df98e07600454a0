"""Open the user's files of fields: NetCDF, Zarr, GRIB; report damage in one line, limit sizes.

Libraries raise errors of many kinds about damaged files, and read any size that a file declares. So
they are called only in this module or inside `reading`, after a check of the sizes.

On a damaged NetCDF 4 file HDF5 may hang, or crash. So such a file is first opened in a process of
its own: if that crashes or exceeds its limit, the file is damaged. A GRIB file is read whole there,
since ecCodes writes its complaints to standard error itself. A NetCDF 4 file of which a part lies
in another file, which the library would read, is refused there, too.

Of a truncated NetCDF file of a classic format the library reads zeros beyond the end. So its header
is read here, which states where each variable begins; see "File Format Specifications" in the
NetCDF User's Guide (CDF-1, CDF-2 and CDF-5). All numbers are big endian, and all items are padded
to 4 bytes. No library does this: SciPy, which maps the whole file, does not know CDF-5.
"""

import contextlib
import math
import struct
import warnings
from collections.abc import Iterable, Iterator, Sequence
from inspect import signature
from pathlib import Path
from signal import Signals
from typing import Any

import numpy as np

from pipeline._types import DataArray, Dataset, FloatArray, Variable
from pipeline.machine.workers import Worker, WorkerEndedError
from pipeline.sources.cf import grib, s100
from pipeline.sources.quantities import CURRENT, Quantity
from pipeline.texts import acts, clean

# Number of bytes within which the first message of a GRIB file begins: a bulletin's header may come
# before it.
_HEADER_BYTES = 100
# First bytes of a NetCDF 4 file.
_HDF5 = b"\x89HDF"
_NEITHER = (
    "it is neither NetCDF, Zarr, GRIB nor S-100; convert it to NetCDF, a GeoTIFF by GDAL's "
    "`gdalwarp -t_srs EPSG:4326 -of netCDF`"
)
# Files that make a folder a Zarr store.
_ZARR_MARKERS = ("zarr.json", ".zgroup", ".zmetadata")
# Largest number of values of an axis: 57 years of hours, or cells of 80 m round the world.
_MAX_AXIS = 500_000
# Largest size of a chunk, bytes: one value of it can't be read without all of it.
_MAX_CHUNK_BYTES = 512 << 20
# Kinds of NumPy types that are numbers.
_NUMBERS = "iuf"
# Kinds of NumPy types that are text.
_TEXT = "SUO"
# Length to which a message of a library is cut, characters.
_MAX_REASON = 200


def _first_bytes(path: Path) -> bytes:
    """Return what a file begins with; nothing where it can't be read, or is a folder."""
    try:
        with path.open("rb") as file:
            return file.read(_HEADER_BYTES)
    except OSError:
        return b""


def is_grib(path: Path) -> bool:
    """Whether a file says that it is GRIB."""
    return b"GRIB" in _first_bytes(path)


def is_zarr(path: Path) -> bool:
    """Whether a path is that of a Zarr store."""
    return path.is_dir() and any((path / name).is_file() for name in _ZARR_MARKERS)


@contextlib.contextmanager
def reading() -> Iterator[None]:
    """Turn errors of libraries about a file into a ValueError."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        # Libraries warn of doubtful attributes; the values, which matter here, are checked.
        warnings.simplefilter("ignore")
        try:
            yield
        except (MemoryError, s100.UnusableError):
            raise
        except Exception as error:  # noqa: BLE001 - any kind, from five libraries
            reason = clean(str(error), _MAX_REASON) or type(error).__name__
            raise ValueError(f"it can't be read: {reason}; fetch it again") from None


def open_dataset(path: Path, quantity: Quantity = CURRENT) -> Dataset:
    """Open a file without reading values or decoding times; ValueError where that fails.

    Of a GRIB file the dataset has the fields of one quantity.

    Attributes become clean text, as damaged ones may be anything.
    """
    import xarray as xr

    if (converted := _converted(path, quantity)) is not None:
        return converted
    with reading():
        store = _store(path)
    if store is None:
        raise ValueError(_NEITHER)
    try:
        with reading():
            variables = store.get_variables()
        for name, variable in variables.items():
            if tuple(variable.dims) == (name,):
                _check_axis_size(str(name), variable.size)
        _check_names(variables)
        with reading():
            # Indexes take half the time where files are many, and nothing here looks them up.
            known = signature(xr.open_dataset).parameters.keys()
            fast: dict[str, Any] = dict.fromkeys({"create_default_indexes"} & known, False)
            dataset = xr.open_dataset(store, decode_times=False, decode_timedelta=False, **fast)
            # Of many open files xarray closes some again: small variables are loaded before that.
            for variable in dataset.variables.values():
                if variable.ndim < 2 and variable.size <= _MAX_VALUES:
                    variable.load()
            dataset = _of_one_version(dataset)
    except ValueError:
        store.close()
        raise
    owners: tuple[Any, ...] = (dataset, *dataset.variables.values())
    for owner in owners:
        owner.attrs = {clean(str(key)): clean(str(value)) for key, value in owner.attrs.items()}
        # Standard names are in lower case; some files of FVCOM begin one with a capital.
        if "standard_name" in owner.attrs:
            owner.attrs["standard_name"] = owner.attrs["standard_name"].lower()
    return dataset


def _of_one_version(dataset: Dataset) -> Dataset:
    """Return a dataset in which ERA5 and its preliminary ERA5T (`expver`) are one series.

    That holds for variables of which each time has values of exactly one of the two.
    """
    for name, array in dataset.data_vars.items():
        time = {"time", "valid_time"} & {*array.dims}
        if "expver" in array.dims and time:
            steps = array.transpose(*time, "expver", ...)
            known = np.array([step.notnull().any(step.dims[1:]) for step in steps])
            if (known.sum(axis=1) == 1).all():
                dataset[name] = array.isel(expver=(steps.dims[0], known.argmax(axis=1)))
                dataset[name].encoding["is_merged"] = True
    return dataset


def open_together(path: Path, beside: Sequence[Path], quantity: Quantity = CURRENT) -> Dataset:
    """Open a file with what others add to it; ValueError where one of them can't be opened.

    Tiles of S-100 become one mesh of points. Any other file lends the variables that this one
    lacks and has the dimensions for: its mesh, its positions, its mask.
    """
    if not beside:
        return open_dataset(path, quantity)
    opened = [open_dataset(one, quantity) for one in (path, *beside)]
    if s100.is_from_s100(opened[0]):
        return s100.joined(opened)
    whole, *lenders = opened
    for lender in lenders:
        lent = {
            name: variable
            for name, variable in lender.variables.items()
            if name not in whole.variables
            and all(whole.sizes.get(dim, size) == size for dim, size in variable.sizes.items())
        }
        whole = whole.assign(lent)
    stack = contextlib.ExitStack()
    for one in opened:
        stack.callback(one.close)
    whole.set_close(stack.close)
    return whole


def _converted(path: Path, quantity: Quantity) -> Dataset | None:
    """Return a dataset made of a file of another format; None for NetCDF and Zarr."""
    if is_grib(path):
        grib.require_library()
        with reading():
            read = grib.read_fields(path, quantity)
        return grib.as_dataset(path, read, quantity)
    with reading():
        if not path.is_file():
            return None
        return s100.as_dataset(path) if s100.is_s100(path) else None


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
    if is_zarr(path) or is_grib(path):
        return ()
    import netCDF4

    with reading(), netCDF4.Dataset(path) as dataset:
        return tuple(dataset.groups)


def coordinate_values(dataset: Dataset, name: str) -> FloatArray:
    """Read a coordinate, or its bounds, as numbers; ValueError where it is something else."""
    variable = dataset.variables[name]
    _check_axis_size(name, variable.size)
    _check_is_number(name, variable)
    with reading():
        return np.asarray(variable.values, dtype=float)


def check_values(array: DataArray) -> None:
    """Refuse a variable whose values are no numbers, or whose chunks do not fit in memory."""
    _check_is_number(str(array.name), array)
    chunks = array.encoding.get("chunksizes") or array.encoding.get("chunks") or ()
    size = math.prod(map(int, chunks)) * array.dtype.itemsize
    if size > _MAX_CHUNK_BYTES:
        raise ValueError(
            f"{array.name} is stored in chunks of {size >> 20:,} MB, above "
            f"{_MAX_CHUNK_BYTES >> 20}; divide them, as with `nccopy -c`"
        )


def _check_is_number(name: str, variable: Variable | DataArray) -> None:
    """Refuse a variable that holds text or anything else that is no number."""
    if variable.dtype.kind not in _NUMBERS:
        kind = "text" if variable.dtype.kind in _TEXT else "another type"
        raise ValueError(f"{name} holds {kind}, not numbers; give it as numbers")


def _check_names(variables: Iterable[str]) -> None:
    """Refuse names of variables that would act on a terminal: messages quote them."""
    if acting := next(filter(None, map(acts, variables)), ""):
        raise ValueError(f"a variable has in its name {acting}; rename it, as with `ncrename -v`")


def _check_axis_size(name: str, size: int) -> None:
    """Refuse an axis that has more values than any real one."""
    if size > _MAX_AXIS:
        raise ValueError(
            f"{name} has {size:,} values, more than {_MAX_AXIS:,}; cut out the region and the time"
        )


# Time for the process to start, and for each file, s: some ms usually, more on slow disks.
_FILE_S = 60.0
# CPU time for each file, s, where the system can limit it: it ends a library that hangs sooner.
_FILE_CPU_S = 4.0
# Bytes of a GRIB file that are read in a second of CPU time: a tenth of what is usual.
_BYTES_S = 5e6
# A variable with at most this number of values is read whole, as an axis is.
_MAX_VALUES = 10_000


# Path, size and time of change of a file -> how the library fails on it; empty if it does not.
_found: dict[tuple[Path, int, int], str] = {}


def fatal_files(files: Sequence[Path]) -> dict[Path, str]:
    """Return the NetCDF 4 and GRIB files on which the library fails, each with its failure.

    On a NetCDF 4 file it hangs or crashes. All files are opened in one process, as its start takes
    longest, and each version of a file only once.
    """
    versions = {
        file: (file, file.stat().st_size, file.stat().st_mtime_ns)
        for file in files
        if _first_bytes(file).startswith(_HDF5) or is_grib(file)
    }
    unknown = tuple(file for file, version in versions.items() if version not in _found)
    fatal = dict(_fatal(unknown))
    _found.update({versions[file]: fatal.get(file, "") for file in unknown})
    return {file: _found[version] for file, version in versions.items() if _found[version]}


def _fatal(files: tuple[Path, ...]) -> Iterator[tuple[Path, str]]:
    """Yield the fatal files among some, each with its failure."""
    with Worker() as worker:
        for file in files:
            try:
                if not worker.is_running:
                    worker.call(_load_libraries)
                    worker.result(_FILE_S)
            except Exception:  # noqa: BLE001 - whatever keeps the process from starting
                return  # the files are read without this probe
            values_s = file.stat().st_size / _BYTES_S if is_grib(file) else 0.0
            try:
                worker.call(probe, file, _FILE_CPU_S + values_s)
                fault = worker.result(_FILE_S + 4 * values_s)
            except WorkerEndedError as ended:
                end = "hangs"
                if ended.exit_code is not None and Signals(-ended.exit_code).name != "SIGXCPU":
                    end = f"ends by {Signals(-ended.exit_code).name}"
                library = "ecCodes" if is_grib(file) else "the HDF5 library"
                fault = f"it is damaged: {library} {end} on it; fetch it again"
            if fault:
                yield file, fault


def _load_libraries() -> None:
    """Import the libraries that open files in the process of their own."""
    import h5py
    import netCDF4

    del h5py, netCDF4


def probe(file: Path, cpu_s: float) -> str:
    """Open a file in a process of its own; return why it can't be used, or ""."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = math.ceil(used.ru_utime + used.ru_stime + cpu_s)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    import netCDF4

    try:
        if is_grib(file):
            grib.require_library()
            with reading():
                grib.check_values(file)
            return ""
        _refuse_parts_elsewhere(file)
    except ValueError as error:
        return str(error)
    # An error is raised again where the file is read.
    with contextlib.suppress(Exception), netCDF4.Dataset(file) as dataset:
        dataset.set_auto_maskandscale(False)
        for variable in dataset.variables.values():
            with contextlib.suppress(Exception):
                _touch(variable)
    return ""


def _refuse_parts_elsewhere(file: Path) -> None:
    """Raise ValueError for an HDF5 file of which a part lies in another file."""
    import h5py

    def visit(name: str, link: object) -> str | None:
        part = opened[name] if isinstance(link, h5py.HardLink) else None
        is_away = isinstance(part, h5py.Dataset) and (part.is_virtual or part.external)
        # A soft link leads to a part of this file, which is visited too.
        is_known = isinstance(link, (h5py.HardLink, h5py.SoftLink))
        return name if is_away or not is_known else None

    with reading():
        try:
            opened = h5py.File(file)
        except OSError:
            return  # the error is raised again where the file is read
        with opened:
            part = opened.visititems_links(visit)
    if part:
        raise ValueError(
            f"{part} is virtual, or in another file, which is not read; copy all into one file, as "
            "with `nccopy`"
        )


def _touch(variable: Any) -> None:  # noqa: ANN401 - netCDF4 has no types
    """Read the description of a variable, and all or some of its values."""
    for name in variable.ncattrs():
        variable.getncattr(name)
    variable.chunking()
    if variable.size <= _MAX_VALUES:
        variable[:]
    else:
        for corner in (0, -1):
            variable[(corner,) * variable.ndim]


MAGIC = b"CDF"
# Size of a value by the number of its type, bytes.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
# Largest number of items of a list in a header: the library's own limit is 8192 variables.
_MAX_ITEMS = 100_000
# Formats of a count, and of a position in the file, by the format's number.
_FORMATS = {1: (">I", ">I"), 2: (">I", ">Q"), 5: (">Q", ">Q")}


def missing_bytes(path: Path) -> int:
    """Return how many bytes a file ends before its last value; 0 where it is complete.

    Raises ValueError, struct.error, LookupError if the header is damaged.
    """
    with path.open("rb") as file:
        count, position = _FORMATS[file.read(4)[3]]

        def number(form: str = count) -> int:
            return int(struct.unpack(form, file.read(struct.calcsize(form)))[0])

        def items() -> range:
            if (length := number()) > _MAX_ITEMS:
                raise ValueError(f"its header states {length:,} items")
            return range(length)

        def skip(size: int) -> None:
            file.seek(_padded(size), 1)

        def skip_attributes() -> None:
            number(">I")
            for _ in items():
                skip(number())
                skip(_SIZES[number(">I")] * number())

        steps = number()
        if steps == 2 ** (8 * struct.calcsize(count)) - 1:
            return 0  # written as a stream: its end is the end of the file
        lengths: list[int] = []
        fixed, records = [(0, 0)], list[tuple[int, int]]()
        number(">I")
        for _ in items():
            skip(number())
            lengths.append(number())
        skip_attributes()
        number(">I")
        for _ in items():
            skip(number())
            shape = [lengths[number()] for _ in items()]
            skip_attributes()
            size = _SIZES[number(">I")]
            number()
            begin = number(position)
            # The length of the dimension that grows is stated as 0; it is always the first.
            grows = shape[:1] == [0]
            (records if grows else fixed).append((begin, size * math.prod(shape[grows:])))
    # The variables of a step are padded, unless there is only one variable.
    step_bytes = sum(_padded(size) if len(records) > 1 else size for _, size in records)
    ends = [begin + size for begin, size in fixed]
    ends += [begin + (steps - 1) * step_bytes + size for begin, size in records if steps]
    return max(0, max(ends) - path.stat().st_size)


def _padded(size: int) -> int:
    """Return the size of an item with its padding."""
    return -(-size // 4) * 4
