"""Find the newest currents, which determine the cycle's name and the time of departures.

A cycle's name is the reference time of its currents, `2026-11-21T00Z`. If the source has no
reference time, the name is the last time step and a hash, `2026-11-24T18Z-1f0c5a7e`. A cycle that
is planned again, because the request or the data have changed, is called `2026-11-21T00Z-r2`. The
machine's clock is only used to leave out currents that are dated in the future.
"""

import contextlib
import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.model.inputs import Issue
from pipeline.nightly.cases import Cases, Member
from pipeline.nightly.outcome import ComeAgainError
from pipeline.scenario.season import Currents, Season, source_name
from pipeline.sources.cf.dataset import fatal_files
from pipeline.sources.registry import current_source

# Number of a hash's digits in a cycle's name.
_DIGITS = 8
_NAME = re.compile(
    r"((\d{4}-\d{2}-\d{2}T\d{2}(?:\d{2})?Z|undated)(?:-[0-9a-f]{8})?)(?:-r(\d{1,6}))?", re.ASCII
)
_FORMATS = ("%Y-%m-%dT%HZ", "%Y-%m-%dT%H%MZ")
_UNDATED = "undated"
# Largest time by which a forecast's reference time may be ahead of the clock, as by time zones.
_AHEAD = timedelta(days=1)
# Largest time by which the last step of currents without a reference time may be ahead of the
# clock: some currents last a season.
_STEPS_AHEAD = timedelta(days=366)


@dataclass(frozen=True)
class Newest:
    """The newest currents of a night.

    Attributes
    ----------
    cycle : the cycle's name.
    time : the currents' reference time; their last step if the source gives none; None if they
        have no time.
    departures_from : earliest time of the first departure.
    digest : hash of all currents' data, or of the numbers that define a plane's current.
    is_timeless : whether all currents are numbers in a plane, for which no new forecast appears.
    ahead : for each source that is dated in the future, the reason why it is not used.
    """

    cycle: str
    time: datetime | None
    departures_from: datetime | None
    digest: str = ""
    is_timeless: bool = False
    ahead: Mapping[Currents, str] = field(default_factory=dict)

    def stale_reason(self, now: datetime, limit_hours: float) -> str:
        """Return a message if the currents are older than the limit, or ""."""
        if self.time is None or now - self.time <= timedelta(hours=limit_hours):
            return ""
        hours = (now - self.time) / timedelta(hours=1)
        return f"the currents are {hours:,.0f} h old, more than {limit_hours:g}"


def newest_currents(cases: Cases, now: datetime, last_night: datetime | None = None) -> Newest:
    """Find the available currents, and name the cycle after the newest.

    Parameters
    ----------
    now
        The time of this machine's clock.
    last_night
        End of the last night according to this clock; None if unknown.

    Raises
    ------
    ComeAgainError
        There are no currents yet; or some are dated in the future and the clock was set back.
    """
    _open_all(cases)
    issues: list[Issue | str] = []
    reasons: dict[str, None] = {}
    ahead: dict[Currents, str] = {}
    for block in cases.blocks:
        if block.scenario.is_planar:
            issues.append("".join(season.model_dump_json() for season in block.seasons))
            continue
        for season in block.seasons:
            for member in block.members:
                issue = _issue(season, member, now, reasons, ahead)
                if issue is not None:
                    issues.append(issue)
    if ahead and last_night is not None and now < last_night:
        raise ComeAgainError(
            f"this machine's clock says {_spelled(now)}, and the last night ended at "
            f"{_spelled(last_night)}: set the clock, and run again"
        )
    if not issues:
        raise ComeAgainError(f"no currents are there yet: {'; '.join(reasons)}; come again later")
    named = _named([one for one in issues if not isinstance(one, str)], issues)
    texts = sorted(one if isinstance(one, str) else one.digest for one in issues)
    return replace(
        named,
        digest=_hash(texts, hashlib.sha256().digest_size * 2),
        is_timeless=all(block.scenario.is_planar for block in cases.blocks),
        ahead=ahead,
    )


def named_currents(season: Season, member: Member | None) -> tuple[Currents, ...]:
    """Return the sources of currents in order of preference: the season's, or the member's file."""
    return season.currents if member is None else ((member.path,),)


def cycle_time(cycle: str) -> datetime | None:
    """Return the time in a cycle's name, or None if the name has none."""
    found = _NAME.fullmatch(cycle)
    if found is None or found[2] == _UNDATED:
        return None
    for form in _FORMATS:
        with contextlib.suppress(ValueError):
            return datetime.strptime(found[2], form).replace(tzinfo=UTC)
    return None


def base_of(cycle: str) -> str:
    """Return a cycle's name without the number of its revision, `-r2`."""
    found = _NAME.fullmatch(cycle)
    return cycle if found is None else found[1]


def revision(cycle: str) -> int:
    """Return the number of a cycle's revision: 1 for the first night on its currents."""
    found = _NAME.fullmatch(cycle)
    return 1 if found is None or found[3] is None else int(found[3])


def is_cycle(name: str) -> bool:
    """Whether a folder's name is a cycle's name."""
    return _NAME.fullmatch(name) is not None


def _open_all(cases: Cases) -> None:
    """Probe all members' files in one process, which is faster, and cache the results."""
    members = (member for block in cases.blocks for member in block.members)
    files = {Path(member.path) for member in members if member is not None}
    fatal_files(sorted(files))


def _issue(
    season: Season,
    member: Member | None,
    now: datetime,
    reasons: dict[str, None],
    ahead: dict[Currents, str],
) -> Issue | None:
    """Return the issue of the first usable source; add why the earlier sources can't be used."""
    for named in named_currents(season, member):
        try:
            source = current_source(named, season.members)
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
    """Return a time as text for a message."""
    return f"{time:%Y-%m-%d %H:%M} UTC"


def _named(dated: list[Issue], issues: Iterable[Issue | str]) -> Newest:
    """Name the cycle after the newest issue, or after a hash of all issues if none has a time."""
    timed = [(one.reference or one.last_step, one) for one in dated]
    known = [(time, one) for time, one in timed if time is not None]
    if not known:
        texts = sorted(one if isinstance(one, str) else one.digest for one in issues)
        return Newest(f"{_UNDATED}-{_hash(texts)}", None, None)
    newest = max(time for time, _ in known)
    of_newest = [one for time, one in known if time == newest]
    form = _FORMATS[1] if newest.minute else _FORMATS[0]
    name = newest.strftime(form)
    if all(one.reference is None for one in of_newest):
        name += f"-{_hash(sorted({one.digest for one in of_newest}))}"
    starts = [one.reference or one.first_step for one in of_newest]
    return Newest(name, newest, min(start for start in starts if start is not None))


def _hash(texts: Iterable[str], digits: int = _DIGITS) -> str:
    """Return the first hexadecimal digits of a hash of texts."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:digits]
