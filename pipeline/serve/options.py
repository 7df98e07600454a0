"""The options of `renew serve`."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from pipeline.voyage.table import Option, read_folder

# Largest number of a port.
_MAX_PORT = 65_535
# The least time limit, s, and the least memory, GB, with which anything can be planned.
_MIN_LIMIT_S = 1.0
_MIN_MEMORY_GB = 0.5
_MAX_WORKERS = 64
_option = partial(Option, group="Other options")


@dataclass(frozen=True, kw_only=True)
class ServerOptions:
    """Where a server answers, where it writes, and how much each plan may take."""

    port: Annotated[
        int | None,
        _option(
            kind="count",
            least=0,
            limit=_MAX_PORT,
            help="Port of 127.0.0.1; 0 for any that is free. Left out, 8137 or any that is free.",
        ),
    ] = None
    opens: Annotated[
        bool, _option(name="open", kind="flag", help="Open the page in the browser.")
    ] = False
    output: Annotated[
        Path,
        _option(
            kind="folder",
            read=read_folder,
            help="Folder of all results; each scenario has its own folder in it.",
        ),
    ] = Path("outputs")
    offline: Annotated[bool, _option(kind="flag", help="Use no source that needs the network.")] = (
        False
    )
    limit: Annotated[
        float,
        _option(kind="number", least=_MIN_LIMIT_S, metavar="SECONDS", help="Time limit of a plan."),
    ] = 600.0
    memory: Annotated[
        float,
        _option(
            kind="number",
            least=_MIN_MEMORY_GB,
            metavar="GB",
            help="Memory limit of a plan's process.",
        ),
    ] = 4.0
    workers: Annotated[
        int,
        _option(kind="count", least=1, limit=_MAX_WORKERS, help="Number of plans at a time."),
    ] = 1
