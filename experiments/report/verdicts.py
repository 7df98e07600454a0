"""The outcome in sentences: where our route needs least fuel, where it loses, what turns met."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from experiments.tables.summary import Row, Table


@dataclass(frozen=True)
class Verdict:
    """A sentence; its kind is "good", "lost" or "plain"."""

    kind: str
    text: str


def verdicts(tables: Sequence[Table]) -> list[Verdict]:
    """Sentences from the tables."""
    by_name = {table.name: table.rows for table in tables}
    return [
        *_least(by_name.get("equal-padding", ()), "At equal padding"),
        *_least(by_name.get("eddies", ()), "In small eddies, unpadded,"),
        *_turns(by_name.get("contingency", ())),
        *_published(by_name),
    ]


def _least(rows: Sequence[Row], where: str) -> Iterator[Verdict]:
    """Whether any rival's best seed undercuts our route."""
    rivals = [row for row in rows if row.get("ours_is")]
    if not rivals:
        return
    lost = [row for row in rivals if row["ours_is"] == "lost"]
    cases = {_case(row) for row in rivals}
    won = len(cases) - len({_case(row) for row in lost})
    closest = min((row for row in rivals if row not in lost), key=_beside, default=None)
    if closest is not None:
        seeds = max(int(str(row["runs"])) for row in rivals)
        count = f"all {len(cases)} cases" if not lost else f"{won} of {len(cases)} cases"
        best = f"with their best of {seeds} seeds" if seeds > 1 else "with their only run"
        yield Verdict(
            "plain" if lost else "good",
            f"{where} no rival needs less fuel than our route, to 0.1 %, in {count}. Rivals count "
            f"{best}; the closest is "
            f"{closest['planner']} in {closest['environment']}, {closest['case']}, with "
            f"{_beside(closest):+.3f} %.",
        )
    for row in lost:
        yield Verdict(
            "lost",
            f"{where} we lose: {row['planner']} needs {-_beside(row):.3f} % less fuel than our "
            f"route in {row['environment']}, {row['case']}.{_steering(row)}",
        )


def _case(row: Row) -> tuple[object, object]:
    """Return the case of a row."""
    return row["environment"], row["case"]


def _beside(row: Row) -> float:
    """How much more fuel a rival needs than our route, percent."""
    return float(str(row["beside_ours_percent"]))


def _steering(row: Row) -> str:
    """A remark where none of a rival's paths can be steered, as ours can."""
    if not str(row["steerable"]).startswith("0/"):
        return ""
    return " No path of that rival there can be steered by this vessel; ours can."


def _turns(rows: Sequence[Row]) -> Iterator[Verdict]:
    """Turns of our adaptively padded routes that met land."""
    total = next((row for row in rows if row["environment"] == "all"), None)
    if total is not None:
        met = int(str(total["full_collisions"]))
        yield Verdict(
            "lost" if met or total["collisions"] else "good",
            f"Hard-over turns from our adaptively padded routes: {total['collisions']} of "
            f"{total['trials']:,} met land by the paper's count, {met} of {total['full_trials']:,} "
            "by ours (the paper: 0 of 5,890).",
        )


def _published(by_name: dict[str, tuple[Row, ...]]) -> Iterator[Verdict]:
    """Our route beside the published one of the same scene."""
    for name in ("main", "ablation"):
        rows = by_name.get(name, ())
        for row in rows:
            is_ours = row["planner"] == "RENEW" and row.get("form") != "k = 1"
            if not (is_ours and row["origin"] == "published"):
                continue
            alike: Row = {"planner": "RENEW", "origin": "computed"}
            alike |= {key: row[key] for key in ("environment", "case")}
            ours = next((other for other in rows if alike.items() <= other.items()), None)
            if ours is not None and ours.get("fuel"):
                is_own_scene = row["scene"] == "ours"
                is_more = float(str(ours["fuel"])) > float(str(row["fuel"]))
                remark = (
                    ": the scene is ours, so this is evidence of nothing" if is_own_scene else ""
                )
                yield Verdict(
                    "lost" if is_more and not is_own_scene else "plain",
                    f"{row['environment']}, {row['case']}: fuel {ours['fuel']:.2f} at a clearance "
                    f"of {ours['clearance_m']:.2f} m, beside {row['fuel']:.2f} at "
                    f"{row['clearance_m']:.2f} m published{remark}.",
                )
