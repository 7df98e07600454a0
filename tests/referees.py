"""Who judges our files: GDAL's checker, the RTZ schemas, axe in the system's own Chromium."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, TypeAlias

from lxml import etree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser, Page

# lxml has no types.
Element: TypeAlias = Any

# A folder with "RTZ Schema version 1_0.xsd" and its like, as published: they are not ours to keep.
_PUBLISHED = os.environ.get("RENEW_RTZ_SCHEMAS")
_STRICT = Path(__file__).with_name("pipeline") / "formats" / "exchange" / "rtz.rng"


def geopackage_faults(package: Path) -> str | None:
    """What GDAL's checker finds wrong with a GeoPackage; None where it is not installed."""
    module = "osgeo_utils.samples.validate_gpkg"
    for python in filter(None, (sys.executable, shutil.which("python3", path="/usr/bin"))):
        probe = [python, "-W", "ignore", "-c", f"import {module}"]
        if subprocess.run(probe, capture_output=True, check=False).returncode:
            continue
        checked = subprocess.run(
            [python, "-W", "ignore", "-m", module, "--extra", str(package)],
            capture_output=True,
            text=True,
            check=False,
        )
        return checked.stdout + checked.stderr if checked.returncode else ""
    return None


def rtz_faults(root: Element, version: str) -> list[str]:
    """What our own strict schema finds wrong, and the published one where it is at hand.

    A text a schema, empty where it finds nothing.
    """
    template = Template(_STRICT.read_text(encoding="utf-8"))
    strict = template.substitute(
        namespace=f"http://www.cirm.org/RTZ/1/{version[-1]}",
        version=version,
        schedule_element="sheduleElement" if version == "1.0" else "scheduleElement",
        extensions="bareExtensions" if version == "1.0" else "wrappedExtensions",
    )
    schemas = [etree.RelaxNG(etree.fromstring(strict.encode()))]
    if _PUBLISHED is not None:
        name = f"RTZ Schema version {version.replace('.', '_')}.xsd"
        schemas.append(etree.XMLSchema(etree.parse(Path(_PUBLISHED) / name)))
    return ["" if schema.validate(root) else str(schema.error_log) for schema in schemas]


@contextlib.contextmanager
def chromium() -> Iterator[Browser | None]:
    """The system's own Chromium; None where there is none."""
    path = shutil.which("chromium")
    if path is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Chromium refuses to sandbox what root runs.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()


def axe_faults(page: Page) -> list[str]:
    """What axe finds serious or critical on a page: the rule, and some of what breaks it."""
    from axe_playwright_python.sync_playwright import Axe

    return [
        f"{violation['id']}: {[node['html'][:200] for node in violation['nodes']][:3]}"
        for violation in Axe().run(page).response["violations"]
        if violation["impact"] in {"serious", "critical"}
    ]
