"""Texts from outside: by Unicode's own tables, nothing of them acts on a terminal or a viewer."""

import csv
import io
import unicodedata

import hypothesis.strategies as st
import pytest
from hypothesis import example, given

from pipeline.texts import acts, cell, clean

# Format characters that are seen (signs of Arabic, Syriac, Kaithi, Egyptian, shorthand, music), and
# the joiners.
_KEPT = (
    *range(0x0600, 0x0606),
    *(0x06DD, 0x070F, 0x0890, 0x0891, 0x08E2, 0x200C, 0x200D, 0x110BD, 0x110CD),
    *range(0x13430, 0x13440),
    *range(0x1BCA0, 0x1BCA4),
    *range(0x1D173, 0x1D17B),
)


def forbidden(text: str) -> set[str]:
    """Return the characters of a text that act on a terminal or a viewer, or can't be seen."""
    return {
        one
        for one in text
        if unicodedata.category(one) in {"Cc", "Cs", "Zl", "Zp"}
        or (unicodedata.category(one) == "Cf" and ord(one) not in _KEPT)
        or one in "\ufffe\uffff"
    }


@pytest.mark.slow
def test_each_character_of_unicode_is_kept_or_taken_out_by_its_category() -> None:
    for code in range(0x110000):
        left = clean(f"a{chr(code)}b")
        assert not forbidden(left), hex(code)
        if forbidden(chr(code)):
            assert acts(f"a{chr(code)}b"), hex(code)
        elif unicodedata.category(chr(code)) not in {"Zs", "Cn"}:
            assert left == unicodedata.normalize("NFC", f"a{chr(code)}b"), hex(code)


@given(st.text(), st.integers(2, 40))
@example("a\u0301" * 30, 10)
@example("\x1b]52;c;ZXZpbA==\x07 \u202egpj.exe", 40)
def test_cleaning_is_final_and_bounded(text: str, limit: int) -> None:
    once = clean(text, limit)
    assert len(once) <= limit
    assert clean(once, limit) == once
    assert not forbidden(once)


@given(st.text())
@example("=cmd|'/C calc'!A0")
@example("-1")
@example("-1+cmd")
@example("+1e3")
def test_no_cell_is_a_formula_and_figures_stay(text: str) -> None:
    file = io.StringIO()
    csv.writer(file).writerow([cell(text), cell(-1.5), cell(None)])
    read, figure, none = next(csv.reader(io.StringIO(file.getvalue(), newline="")))
    assert (figure, none) == ("-1.5", "")
    assert text in {read, read[1:]}
    if read[:1] in {"=", "+", "-", "@", "\t"} and len(read) > 1:
        float(read)


@pytest.mark.parametrize("figure", ["-12.5", "+3", "-.5", "1e-3", "-1E5"])
def test_a_figure_as_text_stays(figure: str) -> None:
    assert cell(figure) == figure
