"""Whether a NetCDF file of a classic format is complete: the library reads zeros beyond its end.

The header states where each variable begins; see "File Format Specifications" in the NetCDF User's
Guide (CDF-1, CDF-2 and CDF-5). All numbers are big endian, and all items are padded to 4 bytes.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

MAGIC = b"CDF"
# Size of a value by the number of its type, bytes.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
# Largest number of items of a list in a header: the library's own limit is 8192 variables.
_MAX_ITEMS = 100_000
# Bytes of a count, and of a position in the file, by the format's number.
_WIDTHS = {1: (4, 4), 2: (4, 8), 5: (8, 8)}


def missing_bytes(path: Path) -> int:
    """Return how many bytes a file ends before its last value; 0 where it is complete.

    Raises
    ------
    ValueError, struct.error, LookupError
        The header is damaged.
    """
    with path.open("rb") as file:
        header = _Header(file, *_WIDTHS[file.read(4)[3]])
        return max(0, _expected_size(header) - path.stat().st_size)


@dataclass
class _Header:
    """Reads the items of a header; the file is just behind the format's number."""

    file: BinaryIO
    count_bytes: int
    position_bytes: int

    def number(self, size: int) -> int:
        """Read a number without a sign."""
        return int(struct.unpack(">I" if size == 4 else ">Q", self.file.read(size))[0])

    def count(self) -> int:
        """Read a number of items."""
        return self.number(self.count_bytes)

    def skip(self, size: int) -> None:
        """Skip an item and its padding."""
        self.file.seek(_padded(size), 1)

    def list_length(self) -> int:
        """Read the beginning of a list: its tag, and the number of its items."""
        self.number(4)
        return self.length()

    def length(self) -> int:
        """Read the number of items of a list; ValueError for more than any file has."""
        count = self.count()
        if count > _MAX_ITEMS:
            raise ValueError(f"its header states {count:,} items")
        return count

    def skip_attributes(self) -> None:
        """Skip a list of attributes."""
        for _ in range(self.list_length()):
            self.skip(self.count())
            size = _SIZES[self.number(4)]
            self.skip(size * self.count())


def _expected_size(header: _Header) -> int:
    """Return where the last value ends, bytes from the file's beginning."""
    steps = header.count()
    if steps == 2 ** (8 * header.count_bytes) - 1:
        return 0  # written as a stream: its end is the end of the file
    lengths = []
    for _ in range(header.list_length()):
        header.skip(header.count())
        lengths.append(header.count())
    header.skip_attributes()
    fixed_ends, records = [0], []
    for _ in range(header.list_length()):
        header.skip(header.count())
        shape = [lengths[header.count()] for _ in range(header.length())]
        header.skip_attributes()
        size = _SIZES[header.number(4)]
        header.count()
        begin = header.number(header.position_bytes)
        # The length of the dimension that grows is stated as 0; it is always the first.
        if shape and shape[0] == 0:
            records.append((begin, size * math.prod(shape[1:])))
        else:
            fixed_ends.append(begin + size * math.prod(shape))
    # A step's parts are padded, unless there is one only.
    step_bytes = sum(_padded(size) if len(records) > 1 else size for _, size in records)
    ends = [begin + (steps - 1) * step_bytes + size for begin, size in records if steps]
    return max(fixed_ends + ends)


def _padded(size: int) -> int:
    """Size of an item with its padding."""
    return -(-size // 4) * 4
