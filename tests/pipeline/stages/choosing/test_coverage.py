"""What the currents of a voyage cover."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import RequestError
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.model import Scenario
from pipeline.scenario.season import Season
from pipeline.stages.region import SourceCoverage, covered_by_currents, require_covered
from pipeline.stages.water_grid import DirectLine
from tests.pipeline.synthetic_currents import dataset, sea, write

PALAWAN = DirectLine.between((120.30, 12.80), (116.80, 7.70))
GLORYS, EMBEDDED = "copernicus-glorys-monthly", "embedded-palawan"


@pytest.fixture(autouse=True)
def _no_account(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.delenv(f"COPERNICUSMARINE_SERVICE_{name}", raising=False)
    monkeypatch.setenv("COPERNICUSMARINE_CREDENTIALS_DIRECTORY", str(tmp_path / "nobody"))


def season(month: str, *currents: str | tuple[str, ...]) -> Season:
    return Season(name=month, valid=month, currents=currents)


def covered(folder: Path, *seasons: Season, direct: DirectLine = PALAWAN) -> SourceCoverage:
    return covered_by_currents(seasons, direct, folder, offline=False)


def test_without_an_account_the_embedded_table_limits_the_region(tmp_path: Path) -> None:
    found = covered(tmp_path, season("2024-07", GLORYS, EMBEDDED))
    assert found.bounds == pytest.approx((114.75, 6.75, 123.25, 14.25))
    assert set(found.sources) == {EMBEDDED}


def test_with_an_account_the_service_has_the_world(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("USERNAME", "PASSWORD"):
        monkeypatch.setenv(f"COPERNICUSMARINE_SERVICE_{name}", "someone")
    west, south, east, north = covered(tmp_path, season("2024-07", GLORYS, EMBEDDED)).bounds
    assert east - west > 290
    assert (south, north) == (-80, 89)


def test_a_file_covers_half_a_cell_beyond_its_nodes(tmp_path: Path) -> None:
    field = sea(np.arange(116, 121.1, 0.5), np.arange(7, 13.6, 0.5))
    path = write(tmp_path / "field.nc", dataset(field))
    found = covered(tmp_path, season("2024-07", (str(path),)))
    assert found.bounds == pytest.approx((115.75, 6.75, 121.25, 13.75))


def test_seasons_limit_the_region_together(tmp_path: Path) -> None:
    field = sea(np.arange(116, 121.1, 0.5), np.arange(6, 13.6, 0.5))
    path = write(tmp_path / "field.nc", dataset(field))
    found = covered(tmp_path, season("2024-07", (str(path),)), season("2024-08", EMBEDDED))
    assert found.bounds == pytest.approx((115.75, 6.75, 121.25, 13.75))
    assert found.sources[1] == EMBEDDED
    assert found.sources[0] == found.sources[3] == "field.nc"


def test_still_water_covers_everything(tmp_path: Path) -> None:
    found = covered(tmp_path, Season(name="still", currents=("still",)))
    assert found.bounds[1] == -89
    assert found.bounds[3] == 89


def test_without_any_current_the_error_says_why_and_what_would_do(tmp_path: Path) -> None:
    aegean = DirectLine.between((23.6, 37.9), (28.3, 36.5))
    with pytest.raises(RequestError) as caught:
        covered(tmp_path, season("2024-07", GLORYS, EMBEDDED), direct=aegean)
    (line,) = caught.value.faults
    assert "free Copernicus Marine account" in line
    assert "embedded-palawan has no data west of 114.75" in line
    assert "--currents FILE" in line
    assert "--currents still" in line


def test_a_season_without_currents_does_not_stop_the_others(tmp_path: Path) -> None:
    found = covered(tmp_path, season("2024-05", GLORYS), season("2024-07", EMBEDDED))
    assert found.bounds == pytest.approx((114.75, 6.75, 123.25, 14.25))


def test_stops_at_the_pole_need_a_region_of_their_own() -> None:
    table = load_scenario("palawan-usv").model_dump(mode="json")
    still = [{"name": "still", "currents": ["still"]}]
    ends = {"start": (10.0, 89.5), "goal": (20.0, -89.6), "seasons": still}
    asked = Scenario.model_validate({**table, "region": None, **ends})
    with pytest.raises(RequestError) as caught:
        require_covered(asked)
    assert [fault.split(" lies beyond 89 degrees")[0] for fault in caught.value.faults] == [
        "start = [10.0, 89.5]",
        "goal = [20.0, -89.6]",
    ]
    region = {"bbox": (-60.0, 87.0, 60.0, 90.0)}
    require_covered(Scenario.model_validate({**table, **ends, "region": region, "goal": (20, 88)}))
