"""What came out, in sentences: where our route is least, where it loses, what turns met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pipeline.experiments.tables.summary import Row, Table


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
    cases = {(row["environment"], row["case"]) for row in rivals}
    if not lost:
        closest = min(float(str(row["beside_ours_percent"])) for row in rivals)
        yield Verdict(
            "good",
            f"{where} our fuel is the least, to 0.1 %, in all of {len(cases)} cases, against the "
            f"best seed of each rival; the closest rival is at {closest:+.3f} %.",
        )
    for row in lost:
        yield Verdict(
            "lost",
            f"{where} we lose: {row['planner']} needs "
            f"{-float(str(row['beside_ours_percent'])):.3f} % less fuel than our route in "
            f"{row['environment']}, {row['case']}.",
        )


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
            ours = next(
                (
                    other
                    for other in rows
                    if other["planner"] == "RENEW"
                    and other["origin"] == "computed"
                    and (other["environment"], other["case"]) == (row["environment"], row["case"])
                ),
                None,
            )
            if ours is not None and ours.get("fuel"):
                is_own_scene = row["scene"] == "ours"
                is_more = float(str(ours["fuel"])) > float(str(row["fuel"]))
                remark = (
                    ": the scene is ours, so this is evidence of nothing" if is_own_scene else ""
                )
                yield Verdict(
                    "lost" if is_more and not is_own_scene else "plain",
                    f"{row['environment']}, {row['case']}: fuel {ours['fuel']:.2f} beside "
                    f"{row['fuel']:.2f} published{remark}.",
                )
