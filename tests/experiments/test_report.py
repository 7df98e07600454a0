"""What the report says of its tables, and how it shows them."""

import pytest

from experiments.report.page import _groups, _row_class
from experiments.report.verdicts import verdicts
from experiments.tables.summary import Row, Table


def rival(case: str, planner: str, percent: float, *, runs: int = 3, steerable: str = "") -> Row:
    """A rival's row of the table of equal padding."""
    return {
        "environment": "Bay",
        "scene": "ours",
        "case": case,
        "planner": planner,
        "origin": "computed",
        "runs": runs,
        "beside_ours_percent": percent,
        "ours_is": "lost" if percent < -0.1 else "least" if percent > 0.1 else "equal",
        "steerable": steerable or f"{runs}/{runs}",
    }


def said(rows: list[Row]) -> list[tuple[str, str]]:
    """Kind and text of the sentences on a table of equal padding."""
    table = Table("equal-padding", tuple(rows))
    return [(verdict.kind, verdict.text) for verdict in verdicts([table])]


def test_where_no_rival_needs_less_the_closest_is_named() -> None:
    rows = [rival("a", "BIT*", 0.4), rival("a", "PRM*", -0.05), rival("b", "BIT*", 1.2)]
    ((kind, text),) = said(rows)
    assert kind == "good"
    assert text == (
        "At equal padding no rival needs less fuel than our route, to 0.1 %, in all 2 cases. "
        "Rivals count with their best of 3 seeds; the closest is PRM* in Bay, a, with -0.050 %."
    )


def test_a_lost_case_is_reported_and_not_counted_as_won() -> None:
    rows = [rival("a", "BIT*", 0.4), rival("b", "BIT*", -0.5), rival("b", "PRM*", 0.2)]
    (kind, text), lost = said(rows)
    assert kind == "plain"
    assert "in 1 of 2 cases" in text
    assert lost == (
        "lost",
        "At equal padding we lose: BIT* needs 0.500 % less fuel than our route in Bay, b.",
    )


@pytest.mark.parametrize(("steerable", "is_remarked"), [("0/3", True), ("1/3", False)])
def test_a_rival_that_cannot_be_steered_is_remarked(steerable: str, is_remarked: bool) -> None:
    _, (_, lost) = said([rival("a", "PRM*", 0.3), rival("b", "BIT*", -0.5, steerable=steerable)])
    assert ("can be steered by this vessel" in lost) == is_remarked


def test_one_run_is_not_called_the_best_of_many() -> None:
    ((_, text),) = said([rival("a", "BIT*", 0.4, runs=1)])
    assert "with their only run" in text


def test_rows_of_a_case_stand_under_one_heading_without_its_columns() -> None:
    rows = (rival("a", "BIT*", 0.4), rival("a", "PRM*", 0.3), rival("b", "BIT*", 1.0))
    columns, groups = _groups(Table("t", rows))
    assert [(heading, len(found)) for heading, found in groups] == [
        ("Bay, a (scene: ours)", 2),
        ("Bay, b (scene: ours)", 1),
    ]
    assert columns[0] == "planner"
    assert not {"environment", "case", "scene"} & set(columns)
    # A table without cases is shown as it is.
    slips: Row = {"environment": "Bay", "planner": "A*", "printed": 128.0}
    columns, groups = _groups(Table("t", (slips,)))
    assert columns == ["environment", "planner", "printed"]
    assert groups == [("", [slips])]


def test_ours_stands_out_among_others_only() -> None:
    ours: Row = {"planner": "RENEW", "origin": "computed"}
    published: Row = {"planner": "RENEW", "origin": "published"}
    other = rival("a", "BIT*", 0.4)
    assert _row_class(ours, [ours, other]) == "ours"
    assert _row_class(ours, [ours, ours]) == ""
    assert _row_class(published, [ours, other, published]) == "published"
