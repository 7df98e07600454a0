"""Which currents are newest: they name the cycle, and departures count from them.

The clock plays no part. A cycle is called `2026-11-21T00Z` by the reference time of its currents;
where their source does not say it, by their last time step and a hash: `2026-11-24T18Z-1f0c5a7e`.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import PipelineError
from pipeline.nightly.outcome import ComeAgainError
from pipeline.sources.currents.cf.dataset import is_hdf5
from pipeline.sources.currents.cf.probe import fatal_files
from pipeline.sources.registry import current_source

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pipeline.nightly.request.cases import Block, Cases, Member
    from pipeline.scenario.season import Season
    from pipeline.sources.interfaces import Issue

# Number of a hash's digits in a cycle's name.
_DIGITS = 8
_NAME = re.compile(r"(\d{4}-\d{2}-\d{2}T\d{2}(?:\d{2})?Z|undated)(-[0-9a-f]{8})?", re.ASCII)
_FORMATS = ("%Y-%m-%dT%HZ", "%Y-%m-%dT%H%MZ")
_UNDATED = "undated"


@dataclass(frozen=True)
class Newest:
    """The newest currents of a night.

    `time` is their reference time, or their last step if the source does not say it, or None where
    they have no time at all. `departures_from` is the moment from which departures count.
    """

    cycle: str
    time: datetime | None
    departures_from: datetime | None


def newest_currents(cases: Cases) -> Newest:
    """Look which currents there are, and name the cycle by the newest.

    Raises
    ------
    ComeAgainError
        None are there yet.
    """
    _open_all(cases)
    issues: list[Issue | str] = []
    reasons: dict[str, None] = {}
    for block in cases.blocks:
        if block.scenario.is_planar:
            issues.append(_plane_digest(block))
            continue
        for season in block.seasons:
            for member in block.members:
                issue = _issue(season, member, reasons)
                if issue is not None:
                    issues.append(issue)
    if not issues:
        raise ComeAgainError(f"no currents are there yet: {'; '.join(reasons)}; come again later")
    return _named([one for one in issues if not isinstance(one, str)], issues)


def named_currents(season: Season, member: Member | None) -> tuple[str | tuple[str, ...], ...]:
    """Return the sources of a season's currents, in order of preference, for a member."""
    return season.currents if member is None else ((member.path,),)


def cycle_time(cycle: str) -> datetime | None:
    """Return the time in a cycle's name; None where it has none, or it is no cycle's name."""
    found = _NAME.fullmatch(cycle)
    if found is None or found[1] == _UNDATED:
        return None
    for form in _FORMATS:
        with contextlib.suppress(ValueError):
            return datetime.strptime(found[1], form).replace(tzinfo=UTC)
    return None


def is_cycle(name: str) -> bool:
    """Whether a folder's name is that of a cycle."""
    return _NAME.fullmatch(name) is not None


def _open_all(cases: Cases) -> None:
    """Try all members' files in one process, which is remembered: one for each takes far longer."""
    members = (member for block in cases.blocks for member in block.members)
    files = {Path(member.path) for member in members if member is not None}
    fatal_files([file for file in sorted(files) if is_hdf5(file)])


def _issue(season: Season, member: Member | None, reasons: dict[str, None]) -> Issue | None:
    """Return the issue of the first source that says it; else add the reasons."""
    for named in named_currents(season, member):
        try:
            source = current_source(named)
            unavailable = source.unavailable_reason()
            if not unavailable:
                return source.issue(season)
        except PipelineError as error:
            unavailable = "; ".join(str(error).splitlines())
        reasons[unavailable] = None
    return None


def _plane_digest(block: Block) -> str:
    """Return what stands for the currents of a plane, which are numbers."""
    return "".join(season.model_dump_json() for season in block.seasons)


def _named(dated: list[Issue], issues: Iterable[Issue | str]) -> Newest:
    """Name the cycle by the newest issue; by all where none has a time."""
    timed = [(one.reference or one.last_step, one) for one in dated]
    known = [(time, one) for time, one in timed if time is not None]
    if not known:
        texts = sorted(one if isinstance(one, str) else one.digest for one in issues)
        return Newest(f"{_UNDATED}-{_hash(texts)}", None, None)
    newest = max(time for time, _ in known)
    of_newest = [one for time, one in known if time == newest]
    form = _FORMATS[1] if newest.minute else _FORMATS[0]
    name = newest.strftime(form)
    said = [one for one in of_newest if one.reference is not None]
    if not said:
        name += f"-{_hash(sorted({one.digest for one in of_newest}))}"
    starts = [one.reference or one.first_step for one in of_newest]
    return Newest(name, newest, min(start for start in starts if start is not None))


def _hash(texts: Iterable[str]) -> str:
    """Return a short hash of some texts."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:_DIGITS]
