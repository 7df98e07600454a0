"""Tidal streams from harmonic constants, plus a residual current from the user's other files."""

import itertools
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Self

import numpy as np
from shapely.geometry import Polygon

from pipeline.errors import RequestError
from pipeline.geo.lonlat import Bounds, common_bounds
from pipeline.model import Credit, CurrentGrid, Land, Note
from pipeline.model.inputs import Issue
from pipeline.scenario.season import STILL, Season, StreamConstants
from pipeline.sources.cf.adapter import CfFiles
from pipeline.sources.cf.contents import name_of
from pipeline.sources.interpolation import bilinear

# Steps of a residual closer than these show the tide, which would count twice.
_LEAST_STEP = timedelta(hours=12)


@dataclass(frozen=True)
class TidalStreams(CfFiles):
    """A file of harmonic constants, with the file's mean, another current, or none."""

    residual: CfFiles | None = None

    @classmethod
    def of(cls, named: StreamConstants) -> Self:
        """Return the source that a scenario names."""
        given = named.residual
        files = None if given is None or given == STILL else CfFiles(tuple(given))
        return cls((named.constants,), with_mean=given is None, residual=files)

    def identity(self, season: Season) -> tuple[str, ...]:
        """Return the hashes of the constants, and those of the residual."""
        own = super().identity(season)
        if self.residual is None:
            return own
        steady = self.residual.identity(_at_departure(season))
        return (*own, *self.residual.identity(season), *steady)

    def uncovered_reason(self, region: Polygon, season: Season) -> str:
        """Say why constants and residual can't give the season's current; empty when they can."""
        reasons = [super().uncovered_reason(region, season)]
        try:
            contents = self.contents()
            if not contents.constituents:
                lacking = "it has no harmonic constants (u_re, u_im, v_re, v_im)"
                remedy = "fit them with `renew tide fit`, or name the file itself in 'currents'"
                reasons = [f"{name_of(contents.files)}: {lacking}; {remedy}"]
            if self.residual is not None:
                reasons.append(_residual_fault(self.residual, region, season))
        except RequestError as error:
            reasons += error.faults
        return "; ".join(dict.fromkeys(filter(None, reasons)))

    def covered_bounds(self, region: Polygon, season: Season) -> Bounds | None:
        """Return the part that both the constants and the residual cover."""
        own = super().covered_bounds(region, season)
        if self.residual is None or own is None:
            return own
        other = self.residual.covered_bounds(region, season)
        return None if other is None else common_bounds(own, other)

    def issue(self, season: Season) -> Issue:
        """Return the issue of the residual, which is what changes, with both hashes."""
        own = super().issue(season)
        if self.residual is None:
            return own
        other = self.residual.issue(season)
        return replace(other, digest=f"{own.digest}{other.digest}")

    def current(self, region: Polygon, season: Season, land: Land, folder: Path) -> CurrentGrid:
        """Return the sum of both on the constants' grid, at the times of the streams' fields."""
        streams = super().current(region, season, land, folder)
        if self.residual is None:
            return streams
        if self.residual.uncovered_reason(region, season):
            season = _at_departure(season)
        return _sum(streams, self.residual.current(region, season, land, folder))


def _at_departure(season: Season) -> Season:
    """Return the season with the one field that is nearest to its departure."""
    valid = f"{season.first_departure:%Y-%m-%dT%H:%MZ}"
    return season.model_copy(update={"time_method": None, "valid": valid})


def _residual_fault(residual: CfFiles, region: Polygon, season: Season) -> str:
    """Say why files can't be a residual; empty when they can."""
    contents = residual.contents()
    name = f"residual {name_of(contents.files)}"
    if contents.constituents:
        return f"{name}: it has harmonic constants itself; give a current without tide"
    step = contents.steps.interval
    if step < _LEAST_STEP and "current-without-tide" not in {one.kind for one in contents.notes}:
        return (
            f"{name}: its steps are {step / timedelta(hours=1):g} hours apart and show the tide, "
            f"which would count twice; give daily means, residual = '{STILL}', or leave it out for "
            "the mean of the constants' file"
        )
    reason = residual.uncovered_reason(region, season)
    return reason and residual.uncovered_reason(region, _at_departure(season))


def _sum(streams: CurrentGrid, residual: CurrentGrid) -> CurrentGrid:
    """Add a residual to streams, linear in time, until it ends."""
    lonlat = np.stack(np.meshgrid(streams.lon, streams.lat), axis=-1)
    times = streams.times_s
    if residual.changes:
        times = times[: max(2, int(np.searchsorted(times, residual.times_s[-1], side="right")))]
    u, v = streams.u[: times.size].copy(), streams.v[: times.size].copy()
    # One field of the residual after the other: each weighs in the hours around it.
    for step, one in enumerate(np.eye(len(residual.times_s))):
        weight = np.interp(times, residual.times_s, one)
        flow = bilinear(residual, lonlat, step)
        for number in np.flatnonzero(weight):
            u[number] += weight[number] * flow[..., 0]
            v[number] += weight[number] * flow[..., 1]
    told = Note.of("streams-on-residual", source=residual.credit.name, valid=residual.valid)
    return replace(
        streams,
        u=u,
        v=v,
        times_s=times,
        credit=_both(streams.credit, residual.credit),
        notes=tuple(dict.fromkeys(itertools.chain(streams.notes, [told], residual.notes))),
        files=tuple(dict.fromkeys((*streams.files, *residual.files))),
    )


def _both(one: Credit, other: Credit) -> Credit:
    """Return the credit of two sources that are used together."""
    texts, licences = (
        "; ".join(dict.fromkeys(filter(None, pair)))
        for pair in ((one.text, other.text), (one.licence, other.licence))
    )
    return replace(one, text=texts, licence=licences)
