from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lxml import etree

from pipeline.formats.shared.text import encodable_text, json_value, xml_text


@given(st.text(st.characters(codec=None)))
def test_every_text_can_be_encoded(text: str) -> None:
    encodable = encodable_text(text)
    encodable.encode()
    if not any("\ud800" <= character <= "\udfff" for character in text):
        assert encodable == text


def test_values_become_those_of_json() -> None:
    values = {
        "numbers": [np.float64(1.5), np.int64(2), math.inf, np.float64(np.nan)],
        "text": "half of a pair \ud83d",
        "nested": {"flag": np.bool_(1), "nothing": None},
    }
    spelt = json.dumps(json_value(values), allow_nan=False, ensure_ascii=False)
    assert json.loads(spelt.encode()) == {
        "numbers": [1.5, 2, None, None],
        "text": "half of a pair \N{REPLACEMENT CHARACTER}",
        "nested": {"flag": True, "nothing": None},
    }


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
