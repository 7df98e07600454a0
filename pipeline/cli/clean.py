"""Free space in an output folder: `renew clean`."""

import re
from pathlib import Path

from pipeline.errors import RequestError
from pipeline.machine.store import MAX_STORE_BYTES, seconds_ago
from pipeline.running.session import clean as clean_store
from pipeline.sources.land.osm import remove_cached

_DAYS = {"h": 1 / 24, "d": 1.0, "w": 7.0}
_MB = 1e6


def clean(output: Path, *, older: str, everything: bool) -> str:
    """Prune the store of an output folder; return one line on the space that was freed.

    Raises
    ------
    RequestError
        `older` is not an age, or there is no store.
    StageError
        A run is using the folder.
    """
    age = re.fullmatch(r"(\d{1,6})([hdw])", older)
    if age is None:
        raise RequestError(
            [f"--older = {older!r} is not an age: give hours, days or weeks, as in 12h, 30d, 2w"]
        )
    days = int(age[1]) * _DAYS[age[2]]
    freed = clean_store(
        output,
        max_bytes=0 if everything else MAX_STORE_BYTES,
        used_before=seconds_ago(days),
    )
    text = (
        f"Freed {freed.size / _MB:,.1f} MB ({freed.files:,} files); {freed.remaining / _MB:,.1f} "
        f"MB remain in {output / '.artefacts'}"
    )
    if everything and (land := remove_cached()):
        text += f". The world's land went from the user's cache, too ({land / _MB:,.1f} MB)"
    return text
