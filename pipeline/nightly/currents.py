"""A night's currents: the newest, and forecasts of earlier nights, which are members of tonight's.

The newest currents name the cycle, and the departures are counted from their time. The machine's
clock is only used to leave out currents that are dated in the future.

Earlier forecasts are kept in `OUTPUT/.forecasts/`. They cost no download, and spread with lead as
the truth does (Hoffman & Kalnay 1983, lagged averages). A night copies the files, because the next
one finds newer ones in their place. Each source has a folder, and in it a folder for each forecast,
named by its reference time, or by its last time step where the files don't say one.
"""

import contextlib
import hashlib
import itertools
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from glob import escape
from pathlib import Path

from pipeline.errors import PipelineError, RequestError, StageError
from pipeline.machine.files import UNFINISHED, file_lock, flush_tree
from pipeline.model.inputs import Issue
from pipeline.nightly.cases import Block
from pipeline.nightly.cycles import UNDATED, dated_name, writing
from pipeline.scenario.season import Currents, Season, source_name
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.contents import find_files
from pipeline.sources.cf.dataset import fatal_files
from pipeline.sources.registry import current_source, weather_files

# Number of a hash's digits in a cycle's name.
_DIGITS = 8
# Largest time by which a forecast's reference time may be ahead of the clock, as by time zones.
_AHEAD = timedelta(days=1)
# Largest time by which the last step of currents without a reference time may be ahead of the
# clock: some currents last a season.
_STEPS_AHEAD = timedelta(days=366)
# Folder of all forecasts, in the output folder.
_FORECASTS = ".forecasts"
# Format of the names of forecasts' folders; the names ascend with time.
_FORECAST = "%Y-%m-%dT%H%MZ"
# Time to wait for another night that keeps forecasts in the same folder, s.
_WAIT_S = 600.0


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

    Raises ComeAgainError if there are no currents yet; or some are dated in the future and the
    clock was set back.

    Parameters
    ----------
    now : the time of this machine's clock.
    last_night : end of the last night according to this clock; None if unknown.
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
    """Return a time as text for a message."""
    return f"{time:%Y-%m-%d %H:%M} UTC"


def _hash(texts: Iterable[str]) -> str:
    """Return a hash of texts, hexadecimal."""
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()


# --- forecasts of earlier nights ---


def keep_forecasts(output: Path, blocks: Iterable[Block], newest: Newest, *, prune: bool) -> None:
    """Copy tonight's files of all sources whose earlier forecasts are members.

    With `prune`, the oldest forecasts go that no case asks for. Raises StageError if they can't be
    written.
    """
    wanted: dict[tuple[str, ...], dict[int, Season]] = {}
    for block in blocks:
        for season, sources in block.sources():
            if season.members is None or not season.members.are_kept:
                continue
            for source in sources:
                if isinstance(source, tuple) and source not in newest.ahead:
                    wanted.setdefault(source, {})[season.members.count] = season
    if not wanted:
        return
    root = output / _FORECASTS
    with writing(root), file_lock(root / "lock", wait_s=_WAIT_S):
        for source, by_count in wanted.items():
            count = max(by_count)
            _copy_forecast(output, source, by_count[count])
            for old in _kept(output, source)[count:] if prune else ():
                shutil.rmtree(old)


def kept_forecasts(
    output: Path, season: Season, sources: Iterable[Currents]
) -> tuple[Currents, ...]:
    """Return the sources with the files of tonight's forecast, and of those before it.

    A source that has no time, or is not there yet, is left out.
    """
    count, kept_sources = (season.members.count if season.members else 0), list[Currents]()
    for source in sources:
        time = _forecast_time(source, season) if isinstance(source, tuple) else None
        if time is not None:
            tonight = time.strftime(_FORECAST)
            kept = [path for path in _kept(output, source) if path.name <= tonight]
            kept_sources.append(tuple(f"{escape(str(path))}/*" for path in kept[:count]))
    return tuple(filter(None, kept_sources))


def _folder(output: Path, source: Currents) -> Path:
    """Return the folder of a source's forecasts."""
    return output / _FORECASTS / _hash([str(source)])[:16]


def _kept(output: Path, source: Currents) -> list[Path]:
    """Return the folders of a source's forecasts, the newest first."""
    paths = _folder(output, source).glob("*Z")
    return sorted((path for path in paths if path.is_dir()), reverse=True)


def _copy_forecast(output: Path, source: tuple[str, ...], season: Season) -> None:
    """Copy a source's files of tonight, unless they are there."""
    time = _forecast_time(source, season)
    if time is None:
        return
    files, place = find_files(source), _folder(output, source) / time.strftime(_FORECAST)
    if place.is_dir() and _stamps(place.iterdir()) == _stamps(files):
        return
    names = [file.name for file in files]
    unfinished = place.with_name(f".{place.name}{UNFINISHED}")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    for at, file in enumerate(files):
        own = f"{at}-{file.name}" if names.count(file.name) > 1 else file.name
        (shutil.copytree if file.is_dir() else shutil.copy2)(file, unfinished / own)
    flush_tree(unfinished)
    shutil.rmtree(place, ignore_errors=True)
    unfinished.rename(place)


def _forecast_time(source: tuple[str, ...], season: Season) -> datetime | None:
    """Return the reference time of a source's files, or their last step; None without either."""
    try:
        issue = CfFiles(source, pair=season.current_variables).issue(season)
    except PipelineError:
        return None
    return issue.reference or issue.last_step


def _stamps(files: Iterable[Path]) -> list[tuple[int, int]]:
    """Return sizes and times of change of files and of what is in folders; a copy keeps them."""
    parts = itertools.chain.from_iterable(
        file.rglob("*") if file.is_dir() else (file,) for file in files
    )
    states = (part.stat() for part in parts if part.is_file())
    return sorted((part.st_size, part.st_mtime_ns) for part in states)
