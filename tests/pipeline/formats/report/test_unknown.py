"""The page on what is not known, and its notices."""

from __future__ import annotations

from dataclasses import replace

from pipeline.findings.result import RunResult
from pipeline.formats.report.page import gather, render
from pipeline.model import ShoreCrossing, ShutStrait
from pipeline.model.inputs import Note
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page
from tests.pipeline.results import with_measures, with_rows


def test_land_of_another_shoreline_stands_above_the_answer_and_an_unknown_current_below(
    result: RunResult,
) -> None:
    known = small_run.without_stand_ins(result)
    summer, winter = known.fetched.currents
    summer = replace(summer, notes=(Note.of("still-water"),))
    known = with_rows(known, lambda name, row: replace(row, filled_share=float(name == "winter")))
    crossings = (ShoreCrossing(1, 119.4, 9.4, 2000.0), ShoreCrossing(1, 119.6, 9.5, 461.0))
    known = with_measures(known, "summer", shore_crossings=crossings)
    other = (ShoreCrossing(2, 119.5, 9.4, 33_000.0),)
    changed = replace(
        with_measures(known, "winter", shore_crossings=other),
        fetched=replace(known.fetched, currents=(summer, winter)),
    )
    page = Page(render(gather(changed)))
    notice, doubt = page.with_class("notice")
    titles = [one.all("h2")[0].flat_text for one in (notice, doubt)]
    assert titles == ["Land of another shoreline on the route", "The current is not known"]
    text = notice.flat_text + doubt.flat_text
    assert "Summer (July 2024): planned without a current." in text
    lacking = f"Winter (December): {winter.credit.name} has no values anywhere on the best route."
    assert lacking in text
    assert "Summer (July 2024): 2.46 km of the best route, at 2 places." in text
    assert "Winter (December): none of the best route, but parts of 1 other route." in text
    above, below = page.html.split('class="cards"')
    assert ("notice-title-1" in above, "doubt-title-1" in below) == (True, True)
    said = " ".join(card.flat_text for card in page.with_class("card"))
    assert "is proven" not in said
    assert said.count("Optimality gapnot proven") == 2
    assert "no current to speak of" not in page.root.text
    (part,) = [
        e for e in page.all("section") if e.attributes.get("aria-labelledby") == "unknown-title"
    ]
    assert "second, independent shoreline" in part.flat_text
    assert len(page.with_class("crossing")) == 2, "in both legends"


def test_other_notes_are_no_warning(result: RunResult) -> None:
    def page_with(*notes: str) -> Page:
        fetched = replace(
            small_run.without_stand_ins(result).fetched, notes=tuple(map(small_run.note, notes))
        )
        return Page(render(gather(replace(result, fetched=fetched))))

    assert page_with().with_class("notice") == []
    page = page_with("islets were merged")
    [notice] = page.with_class("mild")
    assert notice.flat_text == "Notes Islets were merged."
    assert page.html.index('class="cards"') < page.html.index('class="notice mild"')


def test_what_is_not_known_has_a_part_of_its_own(result: RunResult) -> None:
    straits = tuple(
        ShutStrait(119.6, 9.5, 900.0 - i, 1000.0, "padding", ("winter",) if i == 0 else ())
        for i in range(12)
    )
    filled = with_rows(
        small_run.without_stand_ins(result),
        lambda _, row: replace(row, filled_share=0.25 if row.rank == 2 else 0.0),
    )
    changed = replace(filled, straits=straits)
    changed = replace(
        changed,
        fetched=replace(changed.fetched, notes=(small_run.note("a note"), *changed.unknowns)),
    )
    page = Page(render(gather(changed)))
    (part,) = [
        e for e in page.all("section") if e.attributes.get("aria-labelledby") == "unknown-title"
    ]
    sentences = [item.flat_text for item in part.all("li")]
    assert sentences[0].startswith("No depths in this chart: the draught was not used")
    assert any("25.0 % of route 2" in text for text in sentences)
    routes, shut = part.all("table")
    cells = [[cell.flat_text for cell in row.children] for row in routes.all("tr")]
    assert cells[1:] == [
        ["Summer (July 2024)", "2", "25.0 %"],
        ["Winter (December)", "2", "25.0 %"],
    ]
    cells = [[cell.flat_text for cell in row.children] for row in shut.all("tr")]
    assert len(cells) == 11
    assert cells[1] == [
        *("119.6000 E 9.5000 N", "Show", "900.0 m", "1.00 km"),
        "padding, Winter (December)",
    ]
    assert "2 narrower ones are not listed" in part.flat_text
    # What this part of the page says is not repeated as a note.
    notes = [item.flat_text for item in page.all("li") if item not in part.all("li")]
    assert "A note." in notes
    assert not any("draught" in text for text in notes)


def test_a_plane_has_nothing_unknown() -> None:
    page = Page(render(gather(small_run.parts(planar=True))))
    assert "unknown-title" not in {e.attributes.get("id") for e in page.elements}
