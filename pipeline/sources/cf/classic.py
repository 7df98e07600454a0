"""The end of NetCDF files of a classic format, by their headers.

The library reads zeros beyond the end of a truncated NetCDF file of a classic format. So its header
is read here, which states where each variable begins; see "File Format Specifications" in the
NetCDF User's Guide (CDF-1, CDF-2 and CDF-5). All numbers are big endian, and all items are padded
to 4 bytes. No library does this: SciPy, which maps the whole file, does not know CDF-5.
"""

import math
import struct
from pathlib import Path

MAGIC = b"CDF"
# Size of a value by the number of its type, bytes.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
# Largest number of items of a list in a header: the library's own limit is 8192 variables.
_MAX_ITEMS = 100_000
# Formats of a count, and of a position in the file, by the format's number.
_FORMATS = {1: (">I", ">I"), 2: (">I", ">Q"), 5: (">Q", ">Q")}


def missing_bytes(path: Path) -> int:
    """Return how many bytes a file ends before its last value; 0 where it is complete.

    Raises
    ------
    ValueError, struct.error, LookupError
        The header is damaged.
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
