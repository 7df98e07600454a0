"""The version of the program, from a checkout or an installation."""

import tomllib
from importlib.metadata import version
from pathlib import Path

_DISTRIBUTION = "renew-planner"


def program_version() -> str:
    """Return the version that the checkout's pyproject.toml states, or else the installation's."""
    pyproject = Path(__file__).resolve().parents[2] / "pyproject.toml"
    try:
        project = tomllib.loads(pyproject.read_text(encoding="utf-8")).get("project", {})
    except OSError:
        return version(_DISTRIBUTION)
    # An installed package may lie in a folder with another project's pyproject.toml.
    is_own = project.get("name") == _DISTRIBUTION
    return str(project["version"]) if is_own else version(_DISTRIBUTION)
