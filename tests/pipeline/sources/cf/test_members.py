"""Members in the user's own files: files of their own or along a dimension, and their mean."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr

from pipeline.errors import RequestError
from pipeline.findings.note_words import note_texts
from pipeline.model import CurrentGrid, Land
from pipeline.scenario.season import Season
from pipeline.sources.current_field import Field, LandMask
from pipeline.sources.registry import current_source
from tests.pipeline.synthetic_currents import coastal, dataset, sea, write

REGION = shapely.box(118.3, 9.3, 119.2, 10.4)
LON, LAT = np.arange(108.0, 130.0, 0.25), np.arange(0.0, 20.0, 0.25)


@pytest.fixture(scope="module")
def seas(world_mask: LandMask) -> list[Field]:
    """Give three plausible seas around Palawan."""
    return [coastal(sea(LON, LAT, seed=seed), world_mask) for seed in (2, 3, 4)]


def current(paths: list[Path], **members: Any) -> CurrentGrid:  # noqa: ANN401 - keys of TOML
    """Read members as a season's current."""
    names = tuple(str(path) for path in paths)
    season = Season(name="summer", valid="2024-07", currents=(names,), members=members)
    source = current_source(names, season.members)
    if reason := source.uncovered_reason(REGION, season):
        raise RequestError(reason)
    return source.current(REGION, season, Land((), (), 0.0), Path())


def files(folder: Path, seas: list[Field]) -> list[Path]:
    return [write(folder / f"m{at}.nc", dataset(one)) for at, one in enumerate(seas)]


def test_each_file_is_a_member_and_the_current_is_their_mean(
    seas: list[Field], tmp_path: Path
) -> None:
    paths = files(tmp_path, seas)
    alone = [Season(name="one", valid="2024-07", currents=((str(path),),)) for path in paths]
    grids = [
        current_source(one.currents[0]).current(REGION, one, Land((), (), 0.0), Path())
        for one in alone
    ]
    found = current(paths, along="files", weights=[1.0, 1.0, 2.0])
    assert [one.name for one in found.members] == ["m0", "m1", "m2"]
    assert [one.weight for one in found.members] == [0.25, 0.25, 0.5]
    for member, grid in zip(found.members, grids, strict=True):
        assert np.array_equal(member.u, grid.u, equal_nan=True)
    mean = (grids[0].v + grids[1].v + 2 * grids[2].v) / 4
    assert np.allclose(found.v, mean, equal_nan=True)
    assert {name for name, _ in found.files} == {"m0.nc", "m1.nc", "m2.nc"}


def test_members_along_a_dimension_are_those_of_files(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    together = xr.concat([dataset(one) for one in seas], "realization")
    path = write(tmp_path / "all.nc", together)
    by_file, by_index = current(paths, along="files"), current([path], along="realization")
    assert [one.name for one in by_index.members] == [f"realization {at}" for at in range(3)]
    for one, other in zip(by_file.members, by_index.members, strict=True):
        assert np.array_equal(one.u, other.u, equal_nan=True)
    assert np.allclose(by_file.u, by_index.u, equal_nan=True)
    with pytest.raises(RequestError, match=r"plan in all with members = \{ along = 'realization'"):
        current([path, path], along="files")
    with pytest.raises(RequestError, match=r"no dimension .member. for members\.along; it has"):
        current([path], along="member")


def test_a_member_that_fails_is_left_out_by_name(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    fast = Field(LON, LAT, 40 * seas[0].u, 40 * seas[0].v)
    other_nodes = sea(LON + 0.1, LAT, seed=5)
    paths += [
        write(tmp_path / "fast.nc", dataset(fast)),
        write(tmp_path / "shifted.nc", dataset(other_nodes)),
    ]
    found = current(paths, along="files")
    assert [one.name for one in found.members] == ["m0", "m1", "m2"]
    assert sum(one.weight for one in found.members) == pytest.approx(1)
    said = [note for note in note_texts(found.notes) if "was left out" in note]
    assert len(said) == 2
    assert "fast: fast.nc is refused" in said[0]
    assert "shifted has other longitudes than m0" in said[1]


def test_too_few_members_are_refused(seas: list[Field], tmp_path: Path) -> None:
    paths = files(tmp_path, seas)
    with pytest.raises(RequestError, match="members: 1 file; there must be 2 to 200"):
        current(paths[:1], along="files")
    with pytest.raises(RequestError, match=r"members\.weights has 2 numbers for 3 members"):
        current(paths, along="files", weights=[1.0, 2.0])
    with pytest.raises(RequestError, match=r"members\.weights leave less than two members"):
        current(paths, along="files", weights=[0.0, 2.0, 0.0])
    with pytest.raises(RequestError, match=r"3 of 3 members can be used, and members\.choose"):
        current(paths, along="files", choose="p90")


def test_each_folder_is_a_forecast_and_the_newest_is_enough(
    seas: list[Field], tmp_path: Path
) -> None:
    """Each has two files; one of July has no step of June, and one of June alone is left out."""
    paths = []
    for day, one in enumerate(seas, start=1):
        (tmp_path / f"2024-06-0{day}").mkdir()
        for month in ("2024-06", "2024-07"):
            data = dataset(one, times=[f"{month}-15"])
            paths.append(write(tmp_path / f"2024-06-0{day}" / f"{month}.nc", data))
    found = current(paths, along="cycles")
    assert [one.name for one in found.members] == ["2024-06-03", "2024-06-02", "2024-06-01"]
    alone = current(paths[-2:], along="cycles")
    assert alone.members == ()
    assert np.array_equal(found.members[0].u, alone.u, equal_nan=True)
    without = current([path for path in paths if path != paths[1]], along="cycles")
    assert [one.name for one in without.members] == ["2024-06-03", "2024-06-02"]
    assert any("2024-06-01: 2024-06.nc: it has" in one for one in note_texts(without.notes))
    with pytest.raises(RequestError, match=r"2024-06\.nc: it has one time step, 2024-06"):
        current(paths[:-1], along="cycles")
    with pytest.raises(RequestError, match=r"1 of 1 members can be used, and members\.choose"):
        current(paths[-2:], along="cycles", choose="p90")
    (tmp_path / "other" / "2024-06-01").mkdir(parents=True)
    twice = write(tmp_path / "other" / "2024-06-01" / "a.nc", dataset(seas[0]))
    with pytest.raises(RequestError, match="'cycles' needs folders of different names"):
        current([*paths, twice], along="cycles")
