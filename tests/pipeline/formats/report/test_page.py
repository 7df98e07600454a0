from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from dataclasses import replace

import pytest
import shapely

from pipeline.findings import text as texts
from pipeline.findings.result import RunResult
from pipeline.formats.report.page import gather, render
from pipeline.model import Credit
from tests.pipeline.formats import small_run
from tests.pipeline.formats.page import Page

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
    assert links == {small_run.LAND.url}


def test_every_class_is_in_its_seasons_table(page: Page, result: RunResult) -> None:
    for number, case in enumerate(result.cases, start=1):
        header, *rows = table_rows(page, f"season-{number}-title")
        metrics = case.measures.routes
        assert len(rows) == len(metrics)
        for cells, m in zip(rows, metrics, strict=True):
            row = dict(zip(header, cells, strict=True))
            assert row["Rank"] == str(m.rank)
            assert row["Way"] == m.way
            assert float(row["Fuel"]) == pytest.approx(m.fuel, rel=5e-4)
            still = m.fuel / m.length  # 1 m/s and the fuel rate 1
            assert row["Of still water"] == texts.share(still)
            shortest = min(metrics, key=lambda one: one.length_m)
            assert row["Of the shortest way"] == texts.share(m.fuel / shortest.fuel)
            assert row["Length, true"] == texts.distance(m.length_m)
            assert float(row["Length, scaled m"]) == pytest.approx(m.length, rel=5e-4)
            assert float(row["F/D"]) == pytest.approx(m.fuel / m.length, rel=5e-3)
            assert row["Time"] == f"{m.duration_s / 3600:.1f} h"
            assert row["Clearance"] == texts.clearance(m.clearance_m)
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
        assert f"Go {best.way}" in card.flat_text
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


def test_the_best_routes_profile_and_padding_are_plotted(page: Page, result: RunResult) -> None:
    labels = [m.attributes["aria-label"] for m in page.with_class("map")]
    for season, entry in zip(("Summer", "Winter (December)"), result.results, strict=True):
        best = result.case(entry.name).routes[0].metrics
        [profile] = [a for a in labels if a.startswith(f"Along the best route of {season}:")]
        assert f"fuel up to {texts.number(best.fuel)}" in profile
        assert f"at least {texts.clearance(best.clearance_m)}" in profile
        assert sum(a.endswith(f"tightest place of the best route of {season}") for a in labels) == 1


def test_published_figures_are_compared_with_ours(page: Page, result: RunResult) -> None:
    header, *rows = table_rows(page, "published-title")
    table = [dict(zip(header, row, strict=True)) for row in rows]
    assert [row["Planned by"] for row in table] == ["This run", "This run", "Theirs"]
    theirs = table[-1]
    assert theirs["Season"] == "Winter (December)"
    assert float(theirs["F/D"]) == pytest.approx(20 / 22.5, abs=1e-3)
    assert theirs["Length, true"] == "112.5 km"
    assert theirs["Clearance, true"] == "–"
    best = result.case("winter").measures.routes[0]
    assert table[1]["Fuel"] == texts.number(best.fuel)
    assert "Some paper, at 1:5000" in page.root.text


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

    channel = entry.plan.routes[0].channel
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
    [_, details] = page.all("details")
    assert details.all("summary")[0].flat_text == "3 rejected classes, with reasons"
    header, *rows = ([c.flat_text for c in row.children] for row in details.all("tr"))
    # Lengths in reasons are true metres at every scale (tests/pipeline/geo).
    assert header == ["Class", "Map", "Reason", "Fuel without padding"]
    assert rows == [
        ["+7 -8", "", "too narrow <b>", "120.0"],
        ["+9", "", "a twin", "–"],
    ]


def test_cards_state_the_lead_of_the_best_route(page: Page, result: RunResult) -> None:
    for card, case in zip(page.with_class("card"), result.cases, strict=True):
        best, *others = case.measures.routes
        rival = next((m for m in others if m.main_passage != best.main_passage), None)
        name = f"The best way {rival.main_passage}" if rival else "The next best route"
        more = 100 * ((rival or others[0]).fuel / best.fuel - 1)
        assert f"{name} needs {more:.1f} % more fuel" in card.flat_text


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
    assert page.all("img") == page.all("a") == []
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
    # The map's own element has its ratio; the script sets the vessel's colour to its season's.
    assert used <= set(re.findall(r"(--[a-z0-9-]+):", style)) | {"--ratio", "--vessel"}
