"""The page: what it says, what it doesn't know, and what it is made of."""

import base64
import hashlib
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
import shapely

from pipeline.findings import text as texts
from pipeline.findings.result import RunResult
from pipeline.formats import appearance
from pipeline.formats.report.page import gather, render
from pipeline.model import Credit, ShoreCrossing, ShutStrait
from pipeline.model.inputs import Note
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page
from tests.pipeline.results import with_measures, with_rows

HOSTILE = (
    '<script>alert("1")</script>"\'><img src=x onerror=alert(1)> ../../etc \N{ROCKET} \u202eevil'
)


def table_rows(page: Page, caption: str) -> list[list[str]]:
    """Cells of the table in the region that is labelled by a heading's id."""
    region = next(
        e
        for e in page.elements
        if e.attributes.get("aria-labelledby") == caption and e.tag == "div"
    )
    return [[cell.flat_text for cell in row.children] for row in region.all("tr")]


def test_the_page_is_well_formed(page: Page) -> None:
    assert page.unbalanced == []
    assert [e.tag for e in page.root.children] == ["html"]
    ids = [e.attributes["id"] for e in page.elements if "id" in e.attributes]
    assert len(ids) == len(set(ids))
    named = [
        e.attributes[a] for e in page.elements for a in ("aria-labelledby",) if a in e.attributes
    ]
    assert set(named) <= set(ids)
    assert [e.flat_text for e in page.all("h1")] == ["Two islands"]


def test_the_page_loads_nothing(page: Page) -> None:
    assert all("src" not in script.attributes for script in page.all("script"))
    assert page.all("iframe") + page.all("img") + page.all("object") == []
    for element in page.elements:
        for name, value in element.attributes.items():
            assert not name.startswith("on"), (element.tag, name)
            if name in {"src", "srcset", "action", "data", "poster", "background"}:
                pytest.fail(f"{element.tag} {name}={value}")
            if name in {"href", "xlink:href"} and element.tag != "a":
                assert value.startswith(("#", "data:")), (element.tag, value)
    assert [e.attributes["href"] for e in page.all("link")] == ["data:,"]
    style = "".join(e.text for e in page.all("style"))
    assert "url(" not in style
    assert "@import" not in style
    policy = next(e for e in page.all("meta") if "http-equiv" in e.attributes)
    rules = dict(rule.split(maxsplit=1) for rule in policy.attributes["content"].split(";"))
    assert rules["default-src"] == "'none'"
    [code] = [e.text for e in page.all("script") if "type" not in e.attributes]
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    assert rules["script-src"] == f"'sha256-{digest}'"
    links = {e.attributes["href"] for e in page.all("a")}
    assert {link for link in links if not link.startswith("#")} == {small_run.LAND.url}
    ids = {e.attributes.get("id") for e in page.elements}
    assert {link[1:] for link in links if link.startswith("#")} <= ids


def test_every_class_is_in_its_seasons_table(page: Page, result: RunResult) -> None:
    for number, case in enumerate(result.cases, start=1):
        header, *rows = table_rows(page, f"season-{number}-title")
        metrics = case.measures.routes
        assert len(rows) == len(metrics)
        for cells, m, ranked in zip(rows, metrics, case.routes, strict=True):
            row = dict(zip(header, cells, strict=True))
            assert row["Rank"] == str(m.rank)
            assert row["Way"] == m.way
            still = m.fuel / m.length  # 1 m/s and the fuel rate 1
            assert row["Of still water"] == texts.share(still)
            shortest = min(metrics, key=lambda one: one.length_m)
            assert row["Of the shortest way"] == texts.share(m.fuel / shortest.fuel)
            assert row["Length, true"] == texts.distance(m.length_m)
            assert float(row["Length, scaled m"]) == pytest.approx(m.length, rel=5e-4)
            assert float(row["F/D"]) == pytest.approx(m.fuel / m.length, rel=5e-3)
            assert row["Time"] == f"{m.duration_s / 3600:.1f} h"
            assert row["Clearance"] == texts.clearance(m.clearance_m)
            widest = ranked.route.turn_padding.max() * result.scenario.scale
            assert row["Turns need"] == texts.distance(widest)
            assert "Offing" not in row
            assert row["Turns that met land"] == f"{m.collisions} of {m.trials}"
            gap = math.ceil(1000 * m.optimality_gap) / 10
            assert row["Optimality gap"] == f"{gap:.1f} %"  # an upper limit
            assert row["Class"] == m.homotopy
            if m.rank > 1:
                excess = 100 * (m.fuel / metrics[0].fuel - 1)
                assert row["Above the best"] == f"+{excess:.1f} %"


def test_the_answer_comes_first(page: Page, result: RunResult) -> None:
    """A season with a stand-in current does not have the title of the requested one."""
    cards = page.with_class("card")
    assert [c.all("h2")[0].flat_text for c in cards] == ["Summer", "Winter (December)"]
    for card, case in zip(cards, result.cases, strict=True):
        best = case.measures.routes[0]
        assert f"Go {best.main_passage}" in card.flat_text
        assert texts.share(best.fuel / best.length) in card.flat_text
        assert texts.clearance(best.clearance_m) in card.flat_text
        [picture] = card.all("svg")
        assert picture.attributes["class"] == "thumbnail"
        assert f"best route, {best.way}," in picture.attributes["aria-label"]


def test_every_season_has_a_map_with_ids_of_its_own(page: Page) -> None:
    pictures = page.with_class("map")
    assert all(picture.attributes["aria-label"] for picture in pictures)
    maps = [m for m in pictures if m.attributes["aria-label"].startswith("Map of")]
    assert len(maps) == 2
    assert all("best route" in m.attributes["aria-label"] for m in maps)
    assert all(len(m.all("path")) > 20 for m in maps)


def test_the_best_routes_profile_and_padding_are_told(page: Page, result: RunResult) -> None:
    labels = [m.attributes["aria-label"] for m in page.with_class("map")]
    for season, entry in zip(("Summer", "Winter (December)"), result.results, strict=True):
        best = result.case(entry.name).routes[0].metrics
        [profile] = [a for a in labels if a.startswith(f"Along the best route of {season}:")]
        assert f"fuel up to {texts.fuel(best.fuel, best)}" in profile
        assert f"at least {texts.clearance(best.clearance_m)}" in profile
    told = [one for one in page.all("p") if "Padding at the tightest" in one.text]
    assert len(told) == 2


def test_stand_in_currents_are_announced_directly_below_the_answer(page: Page) -> None:
    [notice] = page.with_class("notice")
    assert notice.all("h2")[0].flat_text == "Planned with stand-in currents"
    assert "Summer, requested for July 2024: Test table, valid 2020-06-17" in notice.flat_text
    assert "Winter" not in notice.flat_text
    reason = f"{small_run.REASON[:1].upper()}{small_run.REASON[1:]}."
    assert [item.flat_text for item in notice.all("li")] == [reason]
    assert page.html.index('class="cards"') < page.html.index('class="notice"')


def test_sources_are_credited(page: Page) -> None:
    for credit in (small_run.LAND, small_run.STAND_IN, small_run.PREFERRED):
        assert credit.text in page.root.text
        assert credit.licence in page.root.text
    assert "2020-06-17" in page.root.text


def test_rejected_classes_have_reasons(result: RunResult) -> None:
    [entry, *others] = result.results
    assert entry.plan is not None
    from renew import Rejected

    channel, best = entry.plan.routes[0].channel, entry.measures.routes[0].fuel
    gone = tuple(
        Rejected(name, reason, channel, fuel_source=fuel)
        for name, reason, fuel in (
            ("+7", "too narrow <b>", 130.0),
            ("-8", "too narrow <b>", 120.0),
            ("+9", "a twin", math.inf),
        )
    )
    plan = replace(entry.plan, rejected=gone)
    changed = replace(result, results=(replace(entry, plan=plan), *others))
    page = Page(render(gather(changed)))
    (details,) = page.with_class("fallen")
    assert details.all("summary")[0].flat_text == "3 rejected classes, with reasons"
    header, *rows = ([c.flat_text for c in row.children] for row in details.all("tr"))
    # Lengths in reasons are true metres at every scale (tests/pipeline/geo).
    assert header == ["Class", "Map", "Reason", "Above the best, without padding"]
    assert rows == [
        ["+7 -8", "", "too narrow <b>", f"+{100 * (120 / best - 1):.1f} %"],
        ["+9", "", "a twin", "–"],
    ]


def test_each_season_states_the_lead_of_the_best_route(page: Page, result: RunResult) -> None:
    for part, case in zip(page.with_class("why"), result.cases, strict=True):
        best, *others = case.measures.routes
        rival = next((m for m in others if m.main_passage != best.main_passage), None)
        name = f"The best way {rival.main_passage}" if rival else "The next best route"
        more = 100 * ((rival or others[0]).fuel / best.fuel - 1)
        assert f"{name} needs {more:.1f} % more fuel" in part.flat_text


def test_a_failed_season_has_its_reason(result: RunResult) -> None:
    page = Page(render(gather(small_run.with_a_failed_season(result))))
    [card] = page.with_class("failed")
    assert "No route" in card.flat_text
    assert "no water joins start and goal <b>at all</b>" in card.flat_text
    assert len(page.with_class("classes")) == 1
    assert page.unbalanced == []


def test_a_planar_scenario_is_in_metres(planar_result: RunResult) -> None:
    page = Page(render(gather(planar_result)))
    assert "in metres as given" in page.root.text
    assert "current: given in the scenario" in page.root.text
    assert "Scaled metres are" not in page.root.text


def test_zones_are_listed_and_explained_only_if_there_are_any(
    page: Page, result: RunResult
) -> None:
    assert not any("traffic" in e.flat_text for e in page.all("summary") + page.all("label"))
    zoned = Page(render(gather(small_run.with_zones(result, name=HOSTILE))))
    [details] = [
        e
        for e in zoned.all("details")
        if e.flat_text.startswith("Restricted areas and traffic schemes")
    ]
    assert [item.flat_text for item in details.all("li")] == [
        " ".join(HOSTILE.split()),
        "Traffic scheme: keep to starboard",
    ]
    for before, after in zip(page.with_class("legend"), zoned.with_class("legend"), strict=True):
        known = {item.flat_text for item in before.all("li")}
        new = [item.flat_text for item in after.all("li") if item.flat_text not in known]
        assert new == ["water too shallow for the vessel", "restricted area", "traffic scheme"]
    for section, entry in zip(("season-1-title", "season-2-title"), result.results, strict=True):
        [part] = [
            e
            for e in zoned.elements
            if e.tag == "section" and e.attributes.get("aria-labelledby") == section
        ]
        remarks = [e.flat_text for e in part.all("p") if e.attributes.get("class") == "remark"]
        best = shapely.LineString(result.case(entry.name).routes[0].route.path)
        area = small_run.with_zones(result).open_zones[0][1]
        assert best.intersects(area)
        assert sum("runs through" in remark for remark in remarks) == 1
        assert not any("keep to starboard" in remark for remark in remarks)
    assert zoned.unbalanced == []


def test_sources_state_their_use(page: Page, result: RunResult) -> None:
    assert {"Currents, Summer", "Currents, Winter (December)", "Land"} <= {
        e.flat_text for e in page.all("dt")
    }
    [first, second] = result.fetched.currents
    shared = replace(second, credit=first.credit)
    once = replace(result, fetched=replace(result.fetched, currents=(first, shared)))
    terms = [e.flat_text for e in Page(render(gather(once))).all("dt")]
    assert [term for term in terms if term.startswith("Currents")] == [
        "Currents, Summer, Winter (December)"
    ]


def test_every_line_of_the_map_is_in_its_legend(page: Page, result: RunResult) -> None:
    def live_legend(of: Page) -> list[str]:
        [legend] = of.with_class("interactive")[:1]
        return [item.flat_text for item in legend.all("li")]

    assert "other seasons’ best" in live_legend(page)
    failed = Page(render(gather(small_run.with_a_failed_season(result))))
    assert "other seasons’ best" not in live_legend(failed)


def test_hostile_names_stay_text(result: RunResult) -> None:
    scenario = result.scenario.model_copy(
        update={
            "title": HOSTILE,
            "description": HOSTILE * 3,
            "seasons": tuple(
                s.model_copy(update={"title": HOSTILE}) for s in result.scenario.seasons
            ),
            "vessel": result.scenario.vessel.model_copy(update={"title": HOSTILE}),
        }
    )
    credit = Credit(HOSTILE, "land", HOSTILE, HOSTILE, "javascript:alert(1)")
    land = replace(result.fetched.land, credits=(credit,))
    fetched = replace(
        small_run.without_stand_ins(result).fetched, land=land, notes=(small_run.note(HOSTILE),)
    )
    page = Page(render(gather(replace(result, scenario=scenario, fetched=fetched))))
    assert [e.flat_text for e in page.all("h1")] == [" ".join(HOSTILE.split())]
    assert page.all("img") == []
    assert all(e.attributes["href"].startswith("#") for e in page.all("a"))
    data, _ = page.all("script")
    seasons = json.loads(data.text)["seasons"]
    assert [season["title"] for season in seasons] == [f"Summer ({HOSTILE})", f"Winter ({HOSTILE})"]
    assert not any(name.startswith("on") for e in page.elements for name in e.attributes)
    assert page.unbalanced == []


def test_the_page_is_small_and_has_styles_for_dark_print_and_phone(page: Page) -> None:
    assert len(page.html.encode()) < 800_000
    style = page.all("style")[0].text
    for query in ("prefers-color-scheme: dark", "print", "max-width"):
        assert re.search(rf"@media[^{{]*{query}", style)
    used = set(re.findall(r"var\((--[a-z0-9-]+)[),]", page.html))
    # The map has its ratio, entries of the legend their colours; the script sets the vessel's.
    assert used <= set(re.findall(r"(--[a-z0-9-]+):", style)) | {"--ratio", "--role", "--vessel"}


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
    assert titles == [
        "Check the official chart: land of another shoreline on the route",
        "The current is not known",
    ]
    text = notice.flat_text + doubt.flat_text
    assert "Summer (July 2024): planned without a current." in text
    lacking = f"Winter (December): {winter.credit.name} has no values anywhere on the best route."
    assert lacking in text
    assert "Summer (July 2024): 2.46 km at 2 places." in text
    assert "Winter (December): parts of 1 route, none of the best." in doubt.flat_text
    above, below = page.html.split('class="cards"')
    assert ("notice-title-1" in above, "doubt-title-1" in below) == (True, True)
    said = " ".join(card.flat_text for card in page.with_class("card"))
    assert "Proven" not in said
    assert said.count("Could be better by at mostnot proven") == 2
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
        ShutStrait(
            119.6,
            9.5,
            900.0 - i,
            1000.0,
            760.0,
            "padding",
            ("winter",) if i == 0 else (),
            saves=0.214 if i < 11 else 0.0,
            way=min(1 + i // 2, 5) if i < 11 else 0,
            beside=("Isla Wellington",) if i == 0 else (),
        )
        for i in range(14)
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
        *("1", "21.4 %", "119.6000 E 9.5000 N, Isla Wellington", "Show", "900.0 m", "1.00 km"),
        "padding, Winter (December)",
    ]
    assert "4 other straits are in manifest.json" in part.flat_text
    # What this part of the page says is not repeated as a note.
    notes = [item.flat_text for item in page.all("li") if item not in part.all("li")]
    assert "A note." in notes
    assert not any("draught" in text for text in notes)


def test_a_plane_has_nothing_unknown() -> None:
    page = Page(render(gather(small_run.parts(planar=True))))
    assert "unknown-title" not in {e.attributes.get("id") for e in page.elements}


VENDOR = Path(appearance.__file__).parent / "report" / "vendor" / "leaflet"
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
    assert "Leaflet 1.9.4" in appearance.script()[:200]
    assert "(c) 2010-2023 Vladimir Agafonkin" in appearance.script()[:300]


def test_nothing_in_the_script_can_end_its_element() -> None:
    assert not re.search(r"</script|<!--", appearance.script(), re.IGNORECASE)
    assert "\r" not in appearance.script()


def test_leaflets_style_is_complete_but_fetches_nothing() -> None:
    style = appearance.leaflet_style()
    assert "url(" not in style
    assert ".leaflet-pane" in style
    assert ".leaflet-control-zoom-in" in style
    assert style.count("{") == style.count("}") > 80
