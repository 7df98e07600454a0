from __future__ import annotations

import hashlib
import re
from pathlib import Path

import pytest

from pipeline.formats.report import assets

VENDOR = Path(assets.__file__).parent / "vendor" / "leaflet"
# Hashes of npm package leaflet 1.9.4; leaflet.js without its last line, which names a source map.
PINNED = {
    "leaflet.js": "dc71f8a6880bc3ca1bd9fa8dc5f1af48c702dc510b0a78240a07c5feed7ce935",
    "leaflet.css": "a7837102824184820dfa198d1ebcd109ff6d0ff9a2672a074b9a1b4d147d04c6",
    "LICENSE": "53e8dc25862014e4324741ca18fbe3611e11d42ef69f59f86ea8c5389647d4cb",
}


@pytest.mark.parametrize(("name", "sha256"), PINNED.items())
def test_leaflet_is_as_it_was_published(name: str, sha256: str) -> None:
    assert hashlib.sha256((VENDOR / name).read_bytes()).hexdigest() == sha256


def test_the_script_has_leaflets_copyright() -> None:
    assert "Leaflet 1.9.4" in assets.script()[:200]
    assert "(c) 2010-2023 Vladimir Agafonkin" in assets.script()[:300]


def test_nothing_in_the_script_can_end_its_element() -> None:
    assert not re.search(r"</script|<!--", assets.script(), re.IGNORECASE)
    assert "\r" not in assets.script()


def test_leaflets_style_is_complete_but_fetches_nothing() -> None:
    style = assets.leaflet_style()
    assert "url(" not in style
    assert ".leaflet-pane" in style
    assert ".leaflet-control-zoom-in" in style
    assert style.count("{") == style.count("}") > 80
