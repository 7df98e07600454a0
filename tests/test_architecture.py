"""The walls of the house: who imports whom, what is declared, what the wheel holds, its version."""

import itertools
import re
import shutil
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import grimp
import pytest
import yaml
from importlinter.cli import lint_imports

import renew
from tests.commands import PYTHON, ran
from tests.conftest import ROOT

# Imported by none of our modules, and declared all the same.
NEEDED_UNIMPORTED = {
    "numcodecs": "older ones run code that a Zarr store holds",
    "click": "named only for the pin of copernicusmarine",
    "eccodeslib": "what eccodes is built on, which only some of its wheels say",
}
# Imported along with the library that depends on it and uses its types.
COMES_WITH = {
    "distributed": "dask",
    "llvmlite": "numba",
    "markupsafe": "jinja2",
    "pandas": "geopandas",
    "pydantic-core": "pydantic",
    "starlette": "fastapi",
}
# Modules that take seconds to import, and so may not be loaded for `renew --help`.
HEAVY = {
    "copernicusmarine",
    "distributed",
    "eccodes",
    "fastapi",
    "geopandas",
    "matplotlib",
    "numba",
    "pandas",
    "pydantic",
    "pyfes",
    "uvicorn",
    "xarray",
}


def _canonical(requirement: str) -> str:
    """Name of the distribution in a requirement, as PEP 503 spells it."""
    name = re.match(r"[A-Za-z0-9._-]+", requirement)
    assert name is not None
    return re.sub(r"[-_.]+", "-", name[0]).lower()


@pytest.fixture(scope="module")
def project(root: Path) -> dict[str, Any]:
    """Give the table [project] of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    return table


def _declared(project: dict[str, Any]) -> set[str]:
    """Names of the distributions that are needed, and of those that an extra adds."""
    extras: dict[str, list[str]] = project["optional-dependencies"]
    requirements = itertools.chain(project["dependencies"], *extras.values())
    return {_canonical(requirement) for requirement in requirements}


def test_imports_keep_to_the_walls(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(root)
    kept = lint_imports(config_filename="pyproject.toml", no_cache=True, no_logo=True) == 0
    assert kept, capsys.readouterr().out


def test_what_is_imported_is_declared_and_the_other_way_round(
    root: Path, project: dict[str, Any]
) -> None:
    graph = grimp.build_graph(
        "renew", "pipeline", "experiments", include_external_packages=True, cache_dir=None
    )
    outside = {module for module in graph.modules if graph.is_module_squashed(module)}
    distributions = packages_distributions()
    imported = {
        _canonical(distribution)
        for module in outside - sys.stdlib_module_names
        # Where a package has no build for this Python, it has the name of its module.
        for distribution in distributions.get(module.partition(".")[0], [module.partition(".")[0]])
    }
    groups = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["dependency-groups"]
    declared = _declared(project) | {_canonical(needed) for needed in groups["experiments"]}
    declared |= {name for name, bringer in COMES_WITH.items() if bringer in declared}

    assert imported - declared == set(), "imported, and not declared in pyproject.toml"
    unused = declared - imported - NEEDED_UNIMPORTED.keys() - COMES_WITH.keys()
    assert unused == set(), "declared in pyproject.toml, and imported nowhere"


def test_the_lock_pins_what_is_declared_and_names_no_host(
    root: Path, project: dict[str, Any]
) -> None:
    """Its first part is what plans need, which `make palawan-season` installs."""
    lock = (root / "requirements.lock").read_text("utf-8")
    parts = lock.split("# What tests and documents need besides\n")
    plans, besides = (
        {_canonical(line) for line in part.splitlines() if re.match(r"[A-Za-z0-9]", line)}
        for part in parts
    )

    assert _declared(project) - plans == {"eccodes", "eccodeslib", "triangle"}
    assert {"eccodes", "eccodeslib", "triangle", "pytest", "sphinx"} <= besides - plans
    assert re.findall(r"\S*(?:://|--index|--find-links| @ )\S*", lock) == []


def test_what_forbids_commercial_use_is_an_extra(project: dict[str, Any]) -> None:
    assert "triangle" not in map(_canonical, project["dependencies"])
    extra = project["optional-dependencies"]["triangle"]
    assert [_canonical(requirement) for requirement in extra] == ["triangle"]


def test_the_citation_names_this_version(root: Path, project: dict[str, Any]) -> None:
    # CFF is YAML; what is read here is one `key: value` a line at its top level.
    citation = (root / "CITATION.cff").read_text("utf-8")
    stated = dict(re.findall(r"^([a-z-]+): *\"?([^\"\n]+?)\"?$", citation, re.MULTILINE))
    assert stated["cff-version"] == "1.2.0"
    assert stated["version"] == project["version"]
    assert stated["license"] == project["license"]


def test_the_wheel_holds_every_module_and_the_catalogue(root: Path, tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    ran(*build, cwd=root)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}

    code = {
        path.relative_to(root).as_posix()
        for package in ("renew", "pipeline")
        for path in (root / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    data = {
        f"pipeline/{path.relative_to(root).as_posix()}"
        for folder in ("catalog", "qgis")
        for path in (root / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert held == code | data


def test_the_command_line_starts_without_the_heavy_libraries() -> None:
    script = (
        "import sys, pipeline.cli.main; print(*{name.partition('.')[0] for name in sys.modules})"
    )
    done = ran(*PYTHON, script)
    assert set(done.split()) & HEAVY == set()


def test_citation_and_changelog_have_the_version_and_its_date() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    releases = re.findall(
        r"^## \[(\d+\.\d+\.\d+)\] - (\S+)$",
        (ROOT / "CHANGELOG.md").read_text("utf-8"),
        re.MULTILINE,
    )
    assert releases[0] == (renew.__version__, str(citation["date-released"]))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert citation["version"] == project["version"] == renew.__version__


def test_a_tag_of_this_commit_is_the_version() -> None:
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("needs the repository")
    command = [git, "tag", "--points-at", "HEAD", "--list", "v*"]
    tags = ran(*command, cwd=ROOT)
    assert set(tags.split()) <= {f"v{renew.__version__}"}
