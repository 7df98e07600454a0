"""The one call of the Copernicus Marine client, run as a process of its own.

Reads the arguments of `copernicusmarine.subset` as JSON on standard input. Exit 0: the file is
there; NO_ANSWER: the client gave up without a word, which it does without credentials; 1: its
error stands on standard error.
"""

from __future__ import annotations

import json
import sys

NO_ANSWER = 3


def main() -> int:
    """Download what standard input asks for."""
    # Imported here: it takes seconds, and the parent reads this module for its exit codes.
    import copernicusmarine

    request = json.load(sys.stdin)
    try:
        answer = copernicusmarine.subset(**request)
    except Exception as error:  # noqa: BLE001 - whatever it is, the parent decides
        sys.stderr.write(f"\n{type(error).__name__}: {error}\n")
        return 1
    return NO_ANSWER if answer is None else 0


if __name__ == "__main__":
    sys.exit(main())
