"""The version of the program, from its source tree or its installation."""

import tomllib
from importlib.metadata import version
from pathlib import Path

_DISTRIBUTION = "renew-planner"


def program_version() -> str:
    """Return the version in the source tree's pyproject.toml, or else that of the installation."""
    pyproject = Path(__file__).resolve().parents[2] / "pyproject.toml"
    try:
        project = tomllib.loads(pyproject.read_text(encoding="utf-8")).get("project", {})
    except OSError:
        return version(_DISTRIBUTION)
    # An installed package may lie in a folder with another project's pyproject.toml.
    is_own = project.get("name") == _DISTRIBUTION
    return str(project["version"]) if is_own else version(_DISTRIBUTION)
