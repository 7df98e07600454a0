"""Forecasts of earlier nights in `OUTPUT/.forecasts/`, which are members of tonight's currents.

They cost no download and spread with lead as the truth does (Hoffman & Kalnay 1983, lagged
averages). A night copies the files, because the next one finds newer ones in their place. Each
source has a folder, and in it a folder for each forecast, named by its reference time, or by its
last time step where the files don't say one.
"""

import hashlib
import itertools
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from glob import escape
from pathlib import Path

from pipeline.errors import PipelineError
from pipeline.machine.files import UNFINISHED, file_lock, flush_tree
from pipeline.nightly.cases import Cases
from pipeline.nightly.cycles import writing
from pipeline.nightly.newest_currents import Newest, named_currents
from pipeline.scenario.season import Currents, Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.contents import find_files

# Names ascend with time.
_NAME = "%Y-%m-%dT%H%MZ"
_WAIT_S = 600.0


@dataclass(frozen=True)
class Forecasts:
    """The forecasts that the nights of an output folder have kept."""

    output: Path

    def keep(self, cases: Cases, newest: Newest, *, prune: bool) -> None:
        """Copy tonight's files of all sources whose forecasts are members.

        With `prune`, the oldest forecasts go that no case asks for.

        Raises
        ------
        StageError
            They can't be written.
        """
        wanted: dict[tuple[str, ...], dict[int, Season]] = {}
        for block in cases.blocks:
            for season, member in itertools.product(block.seasons, block.members):
                if season.members is None or not season.members.are_kept:
                    continue
                for named in named_currents(season, member):
                    if isinstance(named, tuple) and named not in newest.ahead:
                        wanted.setdefault(named, {})[season.members.count] = season
        if not wanted:
            return
        with writing(self._root), file_lock(self._root / "lock", wait_s=_WAIT_S):
            for named, by_count in wanted.items():
                self._copy(named, by_count[max(by_count)])
                for old in self._all(named)[max(by_count) :] if prune else ():
                    shutil.rmtree(old)

    def members(self, season: Season, named: Iterable[Currents]) -> tuple[Currents, ...]:
        """Return the sources with the files of tonight's forecast, and of those before it.

        A source that has no time, or is not there yet, is left out.
        """
        count, found = (season.members.count if season.members else 0), list[Currents]()
        for one in named:
            time = _time(one, season) if isinstance(one, tuple) else None
            if time is not None:
                kept = [own for own in self._all(one) if own.name <= time.strftime(_NAME)]
                found.append(tuple(f"{escape(str(own))}/*" for own in kept[:count]))
        return tuple(filter(None, found))

    @property
    def _root(self) -> Path:
        """The folder of all forecasts."""
        return self.output / ".forecasts"

    def _of(self, named: Currents) -> Path:
        """Return the folder of a source."""
        return self._root / hashlib.sha256(str(named).encode()).hexdigest()[:16]

    def _all(self, named: Currents) -> list[Path]:
        """Return the folders of a source's forecasts, the newest first."""
        found = self._of(named).glob("*Z")
        return sorted((one for one in found if one.is_dir()), key=lambda one: one.name)[::-1]

    def _copy(self, named: tuple[str, ...], season: Season) -> None:
        """Copy a source's files of tonight, unless they are there."""
        time = _time(named, season)
        if time is None:
            return
        files, place = find_files(named), self._of(named) / time.strftime(_NAME)
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


def _time(named: tuple[str, ...], season: Season) -> datetime | None:
    """Return the reference time of a source's files, or their last step; None without either."""
    try:
        issue = CfFiles(named).issue(season)
    except PipelineError:
        return None
    return issue.reference or issue.last_step


def _stamps(files: Iterable[Path]) -> list[tuple[int, int]]:
    """Return sizes and times of change of files and of what is in folders; a copy keeps them."""
    parts = itertools.chain.from_iterable(
        file.rglob("*") if file.is_dir() else (file,) for file in files
    )
    found = (part.stat() for part in parts if part.is_file())
    return sorted((one.st_size, one.st_mtime_ns) for one in found)
