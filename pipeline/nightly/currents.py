"""A night's currents: the newest.

The newest currents name the cycle, and the departures are counted from their time. The machine's
clock is only used to leave out currents that are dated in the future.
"""

import contextlib
import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from pipeline.errors import PipelineError, RequestError, StageError
from pipeline.model.inputs import Issue
from pipeline.nightly.cases import Block
from pipeline.nightly.cycles import UNDATED, dated_name
from pipeline.scenario.season import Currents, Season, source_name
from pipeline.sources.cf.dataset import fatal_files
from pipeline.sources.registry import current_source, weather_files

# Number of a hash's digits in a cycle's name.
_DIGITS = 8
# Largest time by which a forecast's reference time may be ahead of the clock, as by time zones.
_AHEAD = timedelta(days=1)
# Largest time by which the last step of currents without a reference time may be ahead of the
# clock: some currents last a season.
_STEPS_AHEAD = timedelta(days=366)


class ComeAgainError(StageError):
    """The currents are not available yet, or older than those of the last cycle; exit code 5."""

    exit_code = 5


@dataclass(frozen=True)
class Newest:
    """The newest currents of a night.

    Attributes
    ----------
    cycle : the cycle's name.
    time : the currents' reference time; their last step if the source gives none; None if they
        have no time.
    departures_from : earliest time of the first departure.
    digest : hash of all currents' and limited weather's data, or of a plane's numbers.
    is_timeless : whether all currents are numbers in a plane, for which no new forecast appears.
    ahead : for each source that is dated in the future, the reason why it is not used.
    """

    cycle: str
    time: datetime | None
    departures_from: datetime | None
    digest: str
    is_timeless: bool
    ahead: Mapping[Currents, str]

    def stale_reason(self, now: datetime, limit_hours: float) -> str:
        """Return a message if the currents are older than the limit, or ""."""
        if self.time is None or now - self.time <= timedelta(hours=limit_hours):
            return ""
        hours = (now - self.time) / timedelta(hours=1)
        return f"the currents are {hours:,.0f} h old, more than {limit_hours:g}"


def newest_currents(
    blocks: Sequence[Block], now: datetime, last_night: datetime | None = None
) -> Newest:
    """Find the available currents, and name the cycle after the newest.

    By this machine's clock it is `now`, and the last night ended at `last_night`, None if unknown.
    Raises ComeAgainError if there are no currents yet; or some are dated in the future and the
    clock was set back.
    """
    members = {Path(member) for block in blocks for member in block.members if member is not None}
    fatal_files(sorted(members))  # all in one process, which is faster; the answers are cached
    issues = list[Issue]()
    planes = list[str]()
    reasons: dict[str, None] = {}
    ahead: dict[Currents, str] = {}
    for block in blocks:
        if block.scenario.is_planar:
            planes.append("".join(season.model_dump_json() for season in block.seasons))
            continue
        for season, sources in block.sources():
            issue = _issue(season, sources, now, reasons, ahead)
            if issue is not None:
                issues.append(issue)
    if ahead and last_night is not None and now < last_night:
        raise ComeAgainError(
            f"this machine's clock says {_spelled(now)}, and the last night ended at "
            f"{_spelled(last_night)}: set the clock, and run again"
        )
    if not issues and not planes:
        raise ComeAgainError(f"no currents are there yet: {'; '.join(reasons)}; come again later")
    weather = [digest for block in blocks for digest in _weather_digests(block)]
    digest = _hash(sorted([*planes, *(issue.digest for issue in issues), *weather]))
    is_timeless = all(block.scenario.is_planar for block in blocks)
    dated = [(issue.reference or issue.last_step, issue) for issue in issues]
    times = [time for time, _ in dated if time is not None]
    if not times:
        return Newest(f"{UNDATED}-{digest[:_DIGITS]}", None, None, digest, is_timeless, ahead)
    newest = max(times)
    of_newest = [issue for time, issue in dated if time == newest]
    cycle = dated_name(newest)
    if all(issue.reference is None for issue in of_newest):
        cycle += f"-{_hash(sorted({issue.digest for issue in of_newest}))[:_DIGITS]}"
    starts = (issue.reference or issue.first_step for issue in of_newest)
    first = min(start for start in starts if start is not None)
    return Newest(cycle, newest, first, digest, is_timeless, ahead)


def _weather_digests(block: Block) -> Iterator[str]:
    """Yield hashes of the files of wind and waves; the currents' tasks say what is missing."""
    for _, source in weather_files(block.scenario):
        with contextlib.suppress(RequestError):
            yield source.issue(block.seasons[0]).digest


def _issue(
    season: Season,
    sources: Iterable[Currents],
    now: datetime,
    reasons: dict[str, None],
    ahead: dict[Currents, str],
) -> Issue | None:
    """Return the issue of the first usable source; add why the earlier sources can't be used."""
    for named in sources:
        try:
            source = current_source(named, season.members, season.current_variables)
            unavailable = source.unavailable_reason()
            if not unavailable:
                issue = source.issue(season)
                unavailable = _ahead_reason(issue, named, now)
                if not unavailable:
                    return issue
                ahead[named] = unavailable
        except PipelineError as error:
            unavailable = "; ".join(str(error).splitlines())
        reasons[unavailable] = None
    return None


def _ahead_reason(issue: Issue, named: Currents, now: datetime) -> str:
    """Return a message if currents are dated in the future according to the clock, or ""."""
    what, time, limit = "reference time", issue.reference, _AHEAD
    if time is None:
        what, time, limit = "last step", issue.last_step, _STEPS_AHEAD
    if time is None or time - now <= limit:
        return ""
    return (
        f"{source_name(named)}: its {what}, {_spelled(time)}, is more than {limit.days} day"
        f"{'s' if limit.days > 1 else ''} ahead of this machine's clock, {_spelled(now)}: "
        "correct the one that is wrong"
    )


def _spelled(time: datetime) -> str:
    return f"{time:%Y-%m-%d %H:%M} UTC"


def _hash(texts: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()
