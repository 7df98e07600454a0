"""Note the date of the earlier results in a scenario's folder if a request is refused."""

import contextlib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from pipeline.errors import RequestError


@contextlib.contextmanager
def dating_earlier_results(output: Path, asked: str) -> Iterator[None]:
    """Add a note to a RequestError if the output folder has results of an earlier run."""
    try:
        yield
    except RequestError as error:
        with contextlib.suppress(Exception):  # a failure here must not hide the error
            error.add_note(_note(output, asked))
        raise


def _note(output: Path, asked: str) -> str:
    """Return a note with the date of a scenario's results; raise an error if there are none."""
    from pipeline.scenario.catalogue import read_toml, scenario_path
    from pipeline.stages.write import MANIFEST, output_directory

    directory = output_directory(output, str(read_toml(scenario_path(asked))["name"]))
    written = datetime.fromtimestamp((directory / MANIFEST).stat().st_mtime, UTC)
    return (
        f"nothing was written: the files in {directory} are those of an earlier run, of "
        f"{written:%Y-%m-%d %H:%M} UTC"
    )
