"""The command `renew qgis install`: puts the plugin into the user's profile of QGIS.

The plugin is in `qgis/`, and in the wheel. QGIS runs it in a Python of its own, so it is given the
path of this program, which it calls.
"""

import os
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli import options
from pipeline.cli.failures import reported_errors
from pipeline.errors import RequestError
from pipeline.machine.paths import folder_to_write, shown

app = typer.Typer(
    help="The plugin for QGIS: tools of its Processing toolbox.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
_PLUGIN = "renew_routes"


@app.callback()
def _group() -> None:
    """Keep `install` a command of its own: a group of one command would be that command."""


@app.command(cls=options.Command)
def install(
    *,
    profile: Annotated[
        str, typer.Option(metavar="NAME", help="The user's profile of QGIS.")
    ] = "default",
    plugins: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of plugins, in place of the profile's."),
    ] = None,
) -> None:
    """Put the plugin into the user's profile of QGIS, in place of an earlier version."""
    with reported_errors():
        if Path(profile).name != profile:
            raise RequestError(f"--profile = {shown(profile)!r} is no name; give one without '/'")
        parent = plugins or _profiles() / profile / "python" / "plugins"
        target = folder_to_write(parent, "--plugins") / _PLUGIN
        if target.exists() and not (target / "metadata.txt").is_file():
            raise RequestError(f"{shown(target)} is something else; move it away")
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(_source(), target, ignore=shutil.ignore_patterns("__pycache__"))
        program = Path(sys.executable).with_name("renew")
        (target / "program.txt").write_text(f"{program}\n", encoding="utf-8")
        typer.echo(
            f"Written to {target}\nStart QGIS anew and tick 'RENEW routes' in Plugins > Manage and "
            f"Install Plugins > Installed, or run `qgis_process plugins enable {_PLUGIN}`"
        )


def _source() -> Path:
    """Return the plugin's folder: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    for place in (package / "qgis" / _PLUGIN, package.parent / "qgis" / _PLUGIN):
        if place.is_dir():
            return place
    raise RequestError(f"no plugin in {package}: the installation is incomplete; install again")


def _profiles() -> Path:
    """Return the folder of QGIS's profiles on Linux."""
    if custom := os.environ.get("QGIS_CUSTOM_CONFIG_PATH"):
        return Path(custom) / "profiles"
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "QGIS" / "QGIS3" / "profiles"
