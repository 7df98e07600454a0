"""How QGIS shows a run: the view of its map, and the styles of its layers."""

import io
import json
import re
import sqlite3
import zipfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, strategies as st
from lxml import etree

import renew
from pipeline.findings.result import RunResult
from pipeline.formats.appearance import COLOURS
from pipeline.formats.gis import layers
from pipeline.formats.gis.geopackage import PROJECT, write_geopackage
from pipeline.formats.gis.styles import inert, literal, map_crs, qml, rendered, style, view
from pipeline.geo.projection import Projection
from pipeline.texts import clean
from tests.pipeline.formats import small_run
from tests.pipeline.formats.gis.cases import ODD, SCRIPT, badly_named, moved_east
from tests.pipeline.formats.gis.tables import LAYERS
from tests.pipeline.results import with_water


def in_waters(result: RunResult, *box: float) -> RunResult:
    """The same run on the chart of a lon/lat box, without land."""
    region = shapely.box(*box)
    projection = Projection.for_region(region)
    chart = renew.Chart(projection.geometry_to_plane(region, densify_m=10_000), [])
    return with_water(result, projection=projection, chart=chart)


@pytest.mark.parametrize(
    ("box", "authority"),
    [
        ((116.0, 7.0, 121.0, 13.0), "EPSG:32650"),
        ((117.9, -34.0, 118.9, -33.0), "EPSG:32750"),
        ((-179.9, 50.0, -178.0, 52.0), "EPSG:32601"),
        ((115.5, 7.0, 122.0, 13.5), "EPSG:32650"),
        ((110.0, 7.0, 124.0, 23.0), ""),
        ((-10.0, 50.0, 20.0, 62.0), ""),
        ((10.0, 83.0, 12.0, 84.5), ""),
    ],
)
def test_the_map_is_in_a_utm_zone_that_is_to_scale(
    result: RunResult, box: tuple[float, float, float, float], authority: str
) -> None:
    """Where a zone is wrong by more than 0.5 % somewhere, the map is in the planner's plane."""
    chosen = map_crs(in_waters(result, *box))
    assert chosen.authority == authority
    plane, west_to_east = Projection(chosen.system.to_wkt()), np.linspace(box[0], box[2], 50)
    points = [(lon, lat) for lon in west_to_east for lat in np.linspace(box[1], box[3], 50)]
    if authority:
        assert np.abs(plane.point_scale(points) - 1).max() <= 5e-3
    planar = plane.to_plane(np.array(points))
    assert (planar >= chosen.bounds[:2]).all()
    assert (planar <= chosen.bounds[2:]).all()


@pytest.mark.parametrize(
    "box",
    [
        (119.0, 9.0, 120.2, 10.0),
        (16.0, 58.0, 18.0, 60.0),
        (110.0, 7.0, 124.0, 23.0),
        (-10.0, 50.0, 20.0, 62.0),
        (100.0, -8.0, 130.0, 8.0),
    ],
    ids=["UTM", "UTM in the north", "transverse Mercator", "Lambert", "Mercator"],
)
def test_arrows_are_turned_by_the_maps_convergence(
    result: RunResult, box: tuple[float, float, float, float]
) -> None:
    """The formula, evaluated in Python, against the projection at points all over the chart."""
    chosen = map_crs(in_waters(result, *box))
    formula, projection = chosen.convergence, Projection(chosen.system.to_wkt())
    python = formula.replace("x($geometry)", "lon").replace("y($geometry)", "lat")
    for lon, lat in np.random.default_rng(0).uniform(box[:2], box[2:], (50, 2)):
        place = {"lon": lon, "lat": lat, "sin": np.sin, "radians": np.radians}
        found = eval(python, {"__builtins__": {}}, place)  # noqa: S307 - our own formula
        true = projection.convergence(np.array([lon, lat]))
        assert found == pytest.approx(float(true), abs=0.1)


def test_on_a_map_around_the_pole_arrows_turn_with_the_longitude(result: RunResult) -> None:
    projection = Projection.for_region(shapely.box(-180, 84, 180, 90))
    ring = shapely.Point(0, 0).buffer(600_000)
    polar = with_water(result, projection=projection, chart=renew.Chart(ring, []))
    formula = map_crs(polar).convergence
    python = formula.replace("x($geometry)", "lon").replace("y($geometry)", "lat")
    for lon in (-170.0, -90.0, 0.0, 45.0, 179.0):
        place = {"lon": lon, "lat": 87.0, "sin": np.sin, "radians": np.radians}
        found = eval(python, {"__builtins__": {}}, place)  # noqa: S307 - our own formula
        # On the map around the pole, a meridian's direction is its longitude.
        assert np.cos(np.radians(found - lon)) == pytest.approx(1.0, abs=1e-4)


def test_across_180_degrees_the_map_is_in_continuous_longitudes(result: RunResult) -> None:
    here, there = map_crs(result), map_crs(moved_east(result, 60.4))
    assert not here.is_lonlat
    assert there.authority == "EPSG:4326"
    assert there.bounds == pytest.approx((179.4 - 0.036, 8.964, 180.6 + 0.036, 10.036), abs=2e-3)


def test_dense_currents_are_thinned_on_a_map_of_the_whole(result: RunResult) -> None:
    """By the points' indices in the grid, so that the rest is a coarser grid."""
    grids = (
        replace(
            grid,
            lon=np.linspace(grid.lon[0], grid.lon[-1], 161),
            lat=np.linspace(grid.lat[0], grid.lat[-1], 161),
        )
        for grid in result.fetched.currents
    )
    dense = replace(result, fetched=replace(result.fetched, currents=tuple(grids)))
    plain, thinned = (
        [
            rule["condition"]
            for group in style("currents", view(one))["rules"]
            for rule in group["children"]
        ]
        for one in (result, dense)
    )
    assert len(plain) == len(thinned) > 1
    assert not any("@map_scale" in condition for condition in plain)
    assert all("@map_scale" in condition for condition in thinned)


NOT_XML = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def query(path: Path, sql: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(path)) as database:
        return database.execute(sql).fetchall()


def styles(path: Path) -> dict[str, Any]:
    """Layer -> the root of its default style."""
    rows = query(path, "SELECT f_table_name, styleQML FROM layer_styles WHERE useAsDefault = 1")
    assert len(rows) == len(dict(rows))
    return {layer: etree.fromstring(qml.encode()) for layer, qml in rows}


def project(path: Path) -> Any:  # noqa: ANN401 - lxml has no types
    """The root of the project inside the file."""
    [(content,)] = query(path, "SELECT content FROM qgis_projects")
    with zipfile.ZipFile(io.BytesIO(bytes.fromhex(content))) as archive:
        [name] = archive.namelist()
        assert name.endswith(".qgs")
        return etree.fromstring(archive.read(name))


def leaves(renderer: Any) -> list[Any]:  # noqa: ANN401 - as above
    return [rule for rule in renderer.iter("rule") if rule.find("rule") is None]


def test_every_layer_has_one_default_style_where_qgis_looks_for_it(package: Path) -> None:
    assert set(styles(package)) == set(LAYERS)
    places = query(
        package, "SELECT f_table_catalog, f_table_schema, f_geometry_column FROM layer_styles"
    )
    assert set(places) == {("", "", "geom")}


def test_every_rule_has_a_symbol_of_its_layer_and_every_symbol_a_rule(result: RunResult) -> None:
    kinds = {"LineString": "line", "Point": "marker", "MultiPolygon": "fill"}
    for layer, about in layers.LAYERS.items():
        root = etree.fromstring(qml(layer, view(result), ()).encode())
        renderer = root.find("renderer-v2")
        symbols = {s.get("name"): s.get("type") for s in renderer.iter("symbol")}
        used = [rule.get("symbol") for rule in leaves(renderer)]
        assert sorted(used) == sorted(symbols)
        assert set(symbols.values()) == {kinds[about["geometry_type"]]}
        keys = [rule.get("key") for rule in renderer.iter("rule")]
        assert len(keys) == len(set(keys))


def test_every_column_has_the_same_alias_in_style_and_schema(package: Path) -> None:
    for layer, root in styles(package).items():
        aliases = {alias.get("field"): alias.get("name") for alias in root.iter("alias")}
        schema = query(
            package,
            f"SELECT column_name, title FROM gpkg_data_columns WHERE table_name = '{layer}'",  # noqa: S608 - our own layers
        )
        assert aliases == dict(schema)
    for layer in project(package).iter("maplayer"):
        assert layer.find("aliases/alias") is not None


def test_seasons_have_colours_of_their_own_and_the_best_route_is_bold(package: Path) -> None:
    renderer = styles(package)["routes"].find("renderer-v2")
    widths: dict[str, dict[str, float]] = {}
    for season in renderer.find("rules"):
        symbols = {s.get("name"): s for s in renderer.iter("symbol")}
        for rule in season:
            top = symbols[rule.get("symbol")].findall("layer")[-1]
            options = {o.get("name"): o.get("value") for o in top.iter("Option")}
            colour = ",".join(options["line_color"].split(",")[:3])
            widths.setdefault(colour, {})[rule.get("filter")] = float(options["line_width"])
    assert len(widths) == 2
    for found in widths.values():
        assert found['"rank" = 1'] > 2 * found['"rank" > 1']


def test_only_the_leading_season_is_shown_in_full(package: Path, result: RunResult) -> None:
    best = {r.season: r.metrics.fuel for r in result.routes if r.rank == 1}
    lead = min(best, key=lambda season: best[season])
    root = project(package)
    first, second, *chart = root.find("layer-tree-group").xpath(
        "./layer-tree-group | ./layer-tree-layer"
    )
    assert first.get("name").lower().startswith(lead)
    on = [
        {node.get("name") for node in group if node.get("checked") == "Qt::Checked"}
        for group in (first, second)
    ]
    shown = {"Routes", "Waypoints", "Cross-track limits", "Soft no-go zones", "Currents"}
    assert on == [shown, {"Routes"}]
    assert {layer.get("checked") for layer in chart} == {"Qt::Checked"}
    names = ["Islands", "Edge of the region", "Land", "Hard no-go zone"]
    assert [layer.get("name") for layer in chart] == names


def test_routes_lie_over_land_and_land_over_the_zones_around_it(package: Path) -> None:
    root = project(package)
    order = [item.text for item in root.find("layer-tree-group/custom-order")]
    assert root.find("layer-tree-group/custom-order").get("enabled") == "1"
    kinds = [re.sub(r"_(season_\d+|all_seasons)$", "", name) for name in order]
    assert sorted(set(kinds), key=kinds.index) == [
        *("islands", "passage", "routes", "path_points", "contingency", "legs"),
        *("region", "coast", "no_go", "soft_no_go", "channels", "currents"),
    ]
    # QGIS replaces shorter identifiers by its own.
    assert all(len(name) > 10 for name in order)
    ids = {layer.findtext("id") for layer in root.iter("maplayer")}
    assert ids == set(order) == {node.get("id") for node in root.iter("layer-tree-layer")}


def test_the_project_names_the_file_that_it_is_in(result: RunResult, tmp_path: Path) -> None:
    write_geopackage(result, tmp_path / "other.gpkg")
    sources = {
        layer.findtext("datasource") for layer in project(tmp_path / "other.gpkg").iter("maplayer")
    }
    assert all(source.startswith("./other.gpkg|layername=") for source in sources)
    [(name, about)] = query(tmp_path / "other.gpkg", "SELECT name, metadata FROM qgis_projects")
    assert name == PROJECT
    assert json.loads(about)["last_modified_time"] == "2026-01-02T03:04:05"


def test_credits_and_title_stand_in_the_project(package: Path) -> None:
    root = project(package)
    assert root.findtext("title") == "Two islands"
    texts = {small_run.LAND.text, small_run.STAND_IN.text, small_run.PREFERRED.text}
    assert {node.text for node in root.findall("projectMetadata/rights")} == texts
    assert set(root.findtext("properties/CopyrightLabel/Label").split("\n")) == texts
    assert {node.text for node in root.findall("projectMetadata/license")} == {
        *("none", "CC0", "CC BY 4.0")
    }


def test_the_water_is_coloured_as_in_the_report(package: Path) -> None:
    gui = project(package).find("properties/Gui")
    channels = [int(gui.findtext(f"CanvasColor{name}Part")) for name in ("Red", "Green", "Blue")]
    assert "#" + bytes(channels).hex() == COLOURS["water"]


def test_bad_names_stay_text(result: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "routes.gpkg"
    write_geopackage(badly_named(result), path)
    documents = [*styles(path).values(), project(path)]
    for root in documents:
        assert not list(root.iter("script"))
        texts = [*root.itertext(), *(v for node in root.iter() for v in node.attrib.values())]
        # QGIS evaluates text between [% and %]; in expressions it is quoted.
        assert not any("[%" in text for text in root.itertext())
        assert not any("[%" in node.get("label", "") for node in root.iter("rule"))
        assert not any("[%" in node.get("name", "") for node in root.iter("layer-tree-group"))
        assert not any(NOT_XML.search(text) for text in texts)
    titles = [g.get("name") for g in documents[-1].iter("layer-tree-group") if g.get("name")]
    assert all(0 < len(title) <= 60 for title in titles)
    for node in documents[-1].iter("datasource"):
        layer, _, subset = node.text.removeprefix("./routes.gpkg|layername=").partition("|subset=")
        assert layer in LAYERS
        assert "|" not in subset
        if subset:
            condition = query(path, f"SELECT DISTINCT season FROM {layer} WHERE {subset}")  # noqa: S608 - as QGIS does
            assert condition in ([(SCRIPT,)], [(ODD,)])


def test_a_failed_season_shows_its_currents_only(result: RunResult, tmp_path: Path) -> None:
    path = tmp_path / "routes.gpkg"
    write_geopackage(small_run.with_a_failed_season(result), path)
    groups = [g for g in project(path).iter("layer-tree-group") if g.get("name")]
    assert [len(list(group)) for group in groups] == [8, 1]


@given(st.text())
def test_inert_text_is_no_expression(text: str) -> None:
    assert "[%" not in inert(text)
    assert inert(text).replace("[ %", "[%") == text.replace("[ %", "[%")


@given(st.text().map(clean))
def test_what_is_filled_in_is_read_as_it_was_also_in_attributes(text: str) -> None:
    """White space too, which XML would fold."""
    text = f"{text}\n\t{text}"
    about = style("region", view(small_run.parts()))
    about["rules"][0]["condition"] = text
    content = rendered("layer.qml.jinja", style=about, columns=[], fields={})
    rule = etree.fromstring(content.encode()).find(".//rule")
    assert (rule.get("filter") or "") == text


@given(st.text().map(clean))
def test_a_literal_is_one_quoted_text(text: str) -> None:
    """Read it by the rules of QGIS's lexer: quotes are doubled, backslashes escape."""
    text = f"{text}\n{text}"
    found = re.fullmatch(r"'((?:[^'\\]|''|\\.)*)'", literal(text), re.DOTALL)
    assert found
    read = re.sub(
        r"''|\\(.)", lambda m: {None: "'", "n": "\n"}.get(m[1], m[1]), found[1], flags=re.DOTALL
    )
    assert read == text


def test_coinciding_routes_of_two_seasons_are_both_visible(
    package: Path, result: RunResult
) -> None:
    """The leading season lies below, and is wider than the other."""
    best = {r.season: r.metrics.fuel for r in result.routes if r.rank == 1}
    lead = min(best, key=lambda season: best[season])
    renderer = styles(package)["routes"].find("renderer-v2")
    symbols = {s.get("name"): s for s in renderer.iter("symbol")}
    seen: dict[bool, tuple[float, int]] = {}
    for season in renderer.find("rules"):
        rule = season.find("rule")
        top = symbols[rule.get("symbol")].findall("layer")[-1]
        (width,) = (o.get("value") for o in top.iter("Option") if o.get("name") == "line_width")
        seen[lead in season.get("filter")] = float(width), int(top.get("pass"))
    assert seen[True][0] > 1.5 * seen[False][0]
    assert seen[True][1] < seen[False][1]
    tree = project(package).find("layer-tree-group")
    drawn = [item.text for item in tree.find("custom-order") if item.text.startswith("routes")]
    nodes = {node.get("id"): node for node in tree.iter("layer-tree-layer")}
    assert nodes[drawn[-1]].getparent().get("name").lower().startswith(lead)
