from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from pipeline.formats.shared.templates import xml_text


@given(st.text())
def test_xml_takes_every_text_and_gives_it_back(text: str) -> None:
    element = etree.Element("a")
    element.text = xml_text(text)
    back = etree.fromstring(etree.tostring(element)).text or ""
    assert back == element.text
    replaced = [a for a, b in zip(text, xml_text(text), strict=True) if a != b]
    for character in replaced:
        with pytest.raises(ValueError, match="XML"):
            element.text = character
