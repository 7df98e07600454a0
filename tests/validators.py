"""External validators of our files: GDAL's checker, RTZ schemas, axe in the system's Chromium."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Any, TypeAlias

from lxml import etree
from playwright.sync_api import Browser, Page

from tests.commands import ended

# lxml has no types.
Element: TypeAlias = Any

# Folder with the published schemas, such as "RTZ Schema version 1_0.xsd", which we may not include.
_PUBLISHED = os.environ.get("RENEW_RTZ_SCHEMAS")
_STRICT = Path(__file__).with_name("pipeline") / "formats" / "passage" / "rtz.rng"


def geopackage_faults(package: Path) -> str | None:
    """Faults that GDAL's checker finds in a GeoPackage, as text; None if it is not installed."""
    module = "osgeo_utils.samples.validate_gpkg"
    for python in filter(None, (sys.executable, shutil.which("python3", path="/usr/bin"))):
        probe = [python, "-W", "ignore", "-c", f"import {module}"]
        if subprocess.run(probe, capture_output=True, check=False).returncode:
            continue
        checked = ended(python, "-W", "ignore", "-m", module, "--extra", str(package))
        return checked.stdout + checked.stderr if checked.returncode else ""
    return None


def rtz_faults(root: Element, version: str) -> list[str]:
    """Faults by our own strict schema and, if available, the published one.

    One text per schema, empty if the file is valid.
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
    """The system's own Chromium; None if it is not installed."""
    path = shutil.which("chromium")
    if path is None:
        yield None
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Chromium refuses to run as root with its sandbox.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()


def axe_faults(page: Page) -> list[str]:
    """Serious and critical faults that axe finds on a page: the rule, and some of the elements."""
    from axe_playwright_python.sync_playwright import Axe

    return [
        f"{violation['id']}: {[node['html'][:200] for node in violation['nodes']][:3]}"
        for violation in Axe().run(page).response["violations"]
        if violation["impact"] in {"serious", "critical"}
    ]
