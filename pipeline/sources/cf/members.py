"""Members of a forecast in the user's own files: files, folders, or along a dimension."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon

from pipeline._types import FloatArray
from pipeline.errors import RequestError
from pipeline.geo.lonlat import Bounds
from pipeline.model import CurrentGrid, Land, MemberGrid, Note
from pipeline.model.inputs import CurrentSource, Issue
from pipeline.scenario.members import CYCLES, FILES, MembersSpec
from pipeline.scenario.season import Season
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.contents import find_files
from pipeline.sources.cf.dataset import fatal_files, open_dataset
from renew.planner.ensemble.statistics import FEWEST, QUANTILES

# Least number of members, and the most that are read.
_LEAST, _MOST = 2, 200


@dataclass(frozen=True)
class CfMembers(CurrentSource):
    """Files whose fields are members; the season's current is their mean."""

    paths: tuple[str, ...]
    spec: MembersSpec

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return what each member depends on, and the weights."""
        try:
            members = self._members()
        except RequestError:
            return ("nothing", *self.paths)
        each = [part for _, one in members for part in one.identity(season)]
        return ("members", self.spec.along, str(self.spec.weights), *each)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say why the first member can't be used, or why there are no members."""
        try:
            return self._members()[0][1].uncovered_reason(region, season)
        except RequestError as error:
            return "; ".join(error.faults)

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part that the first member covers."""
        try:
            return self._members()[0][1].covered_bounds(region, season)
        except RequestError:
            return None

    def issue(self, season: Season) -> Issue:
        """Return the first member's issue, with the hashes of all."""
        issues = [one.issue(season) for _, one in self._members()]
        return replace(issues[0], digest="".join(one.digest for one in issues))

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Read each member, checked like any current, and take their mean.

        A member that is refused, or on other nodes or at other times than the first one that can be
        used, is left out by name. Of forecasts, the newest must be usable, and is enough.
        """
        found: list[tuple[str, CurrentGrid, float]] = []
        out: list[str] = []
        members = self._members()
        for (name, source), weight in zip(members, self._weights(len(members)), strict=True):
            try:
                grid = source.current(region, season, land, folder)
            except RequestError as error:
                if self._are_cycles and not found:
                    raise
                out.append(f"{name}: {'; '.join(str(error).splitlines())}")
                continue
            if found and (differs := _difference(grid, found[0][1])):
                out.append(f"{name} has {differs} than {found[0][0]}")
                continue
            found.append((name, grid, weight))
        left = [Note.of("member-left-out", reason=reason) for reason in out]
        choose = self.spec.choose
        needed, whose = (1 if self._are_cycles else _LEAST), "an ensemble has"
        if choose in QUANTILES:
            needed, whose = FEWEST, f"members.choose = {choose!r} needs"
        if len(found) < needed:
            few = f"{len(found)} of {len(members)} members can be used, and {whose} {needed}"
            remedy = "or choose by the mean" if choose in QUANTILES else "or leave 'members' out"
            raise RequestError("; ".join([*out, f"{few}; give more, {remedy}"]))
        if len(found) == 1:
            return replace(found[0][1], notes=(*found[0][1].notes, *left))
        weights = np.array([weight for *_, weight in found])
        if (weights > 0).sum() < _LEAST:
            raise RequestError("members.weights leave less than two members; raise them")
        weights /= weights.sum()
        first = found[0][1]
        notes = dict.fromkeys(note for _, grid, _ in found for note in grid.notes)
        return replace(
            first,
            u=_mean([grid.u for _, grid, _ in found], weights),
            v=_mean([grid.v for _, grid, _ in found], weights),
            members=tuple(
                MemberGrid(name, grid.u, grid.v, float(weight))
                for (name, grid, _), weight in zip(found, weights, strict=True)
            ),
            files=tuple(dict.fromkeys(one for _, grid, _ in found for one in grid.files)),
            notes=(*notes, *left),
        )

    def _members(self) -> list[tuple[str, CfFiles]]:
        """Return each member's name and source; RequestError where there are too few or many."""
        files = find_files(self.paths)
        if self.spec.along == FILES:
            names = [file.stem for file in files]
            if len(set(names)) < len(names):
                names = [file.name for file in files]
            found = [(name, CfFiles((str(file),))) for name, file in zip(names, files, strict=True)]
            what = f"{len(found)} file{'s' * (len(found) != 1)}"
        elif self._are_cycles:
            folders = sorted({file.parent for file in files}, key=lambda one: one.name)[::-1]
            if len({one.name for one in folders}) < len(folders):
                raise RequestError(
                    "members.along = 'cycles' needs folders of different names, one a forecast: "
                    f"{', '.join(one.name for one in folders)}"
                )
            found = [
                (folder.name, CfFiles(tuple(str(one) for one in files if one.parent == folder)))
                for folder in folders
            ]
            what = f"{len(found)} folder{'s' * (len(found) != 1)}"
        else:
            along = self.spec.along
            size = _size_along(files, along)
            each = [(f"{along} {at}", (along, at)) for at in range(size)]
            found = [(name, CfFiles(self.paths, index=index)) for name, index in each]
            what = f"{size} along {along}"
        least = 1 if self._are_cycles else _LEAST
        if not least <= len(found) <= _MOST:
            raise RequestError(f"members: {what}; there must be {least} to {_MOST}")
        return found

    @property
    def _are_cycles(self) -> bool:
        """Whether the members are forecasts in folders, the newest first."""
        return self.spec.along == CYCLES

    def _weights(self, count: int) -> Sequence[float]:
        """Return a weight for each member; RequestError for another number of weights."""
        if not self.spec.weights:
            return [1.0] * count
        if len(self.spec.weights) != count:
            raise RequestError(
                f"members.weights has {len(self.spec.weights)} numbers for {count} members; give "
                "one for each, or leave them out"
            )
        return self.spec.weights


def _size_along(files: Sequence[Path], along: str) -> int:
    """Return the number of members along a dimension of the first file."""
    if fatal := fatal_files(files[:1]):
        raise RequestError(f"{files[0].name}: {fatal[files[0]]}")
    try:
        with open_dataset(files[0]) as dataset:
            if along in dataset.sizes:
                return int(dataset.sizes[along])
            there = ", ".join(map(str, dataset.sizes))
    except ValueError as error:
        raise RequestError(f"{files[0].name}: {error}") from None
    raise RequestError(
        f"{files[0].name} has no dimension {along!r} for members.along; it has {there}"
    )


def _difference(one: CurrentGrid, first: CurrentGrid) -> str:
    """Say in what a member differs from the first one, so that they have no mean; or ""."""
    for name, what in (("lon", "other longitudes"), ("lat", "other latitudes")):
        if not np.array_equal(getattr(one, name), getattr(first, name)):
            return what
    if not np.array_equal(one.times_s, first.times_s):
        return "other times"
    return "" if one.valid == first.valid else f"another time ({one.valid}, not {first.valid})"


def _mean(parts: Sequence[FloatArray], weights: FloatArray) -> FloatArray:
    """Return the mean (nt, ny, nx) of a component over the members; NaN where any has none."""
    return np.asarray(np.tensordot(weights, np.array(parts), axes=1))
