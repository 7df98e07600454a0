"""All tables of the report from the results of all runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.experiments.baselines.registry import PLANNERS
from pipeline.experiments.plan_of_jobs import ORDERS
from pipeline.experiments.tables.published import published_row, slips
from pipeline.experiments.tables.summary import Row, Runs, Table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from pipeline.experiments.environments.model import Case, EnvironmentSpec
    from pipeline.experiments.jobs import Result

LEAST_BY = 1e-3
"""Share by which a rival may undercut our fuel before it is said that we lose: 0.1 %."""


class Results:
    """Results by what was asked."""

    def __init__(self, results: Sequence[Result]) -> None:
        self.all = tuple(results)

    def of(
        self, spec: EnvironmentSpec, case: Case, planner: str, water: str = "bare"
    ) -> list[Result]:
        """Runs of a planner in a case with its whole budget, by seed."""
        budgets = self.by_budget(spec, case, planner, water)
        return budgets[max(budgets)] if budgets else []

    def by_budget(
        self, spec: EnvironmentSpec, case: Case, planner: str, water: str
    ) -> dict[int, list[Result]]:
        """Runs of a planner in a case by its budget in calls (0 if it has none), then by seed."""
        found: dict[int, list[Result]] = {}
        for result in sorted(self.all, key=lambda result: result.job.seed):
            job, options = result.job, dict(result.job.options)
            asked = (job.environment, job.case, job.planner, job.water)
            if asked == (spec.name, case.name, planner, water) and "order" not in options:
                found.setdefault(int(options.get("calls", 0)), []).append(result)
        return found

    def swept(self, spec: EnvironmentSpec, order: str) -> list[tuple[int, Result]]:
        """Plans of an environment by k, classes taken in an order."""
        found = []
        for result in self.all:
            options = dict(result.job.options)
            if result.job.environment == spec.name and options.get("order") == order:
                found.append((int(options["classes"]), result))
        return sorted(found, key=lambda item: item[0])


def tables(specs: Sequence[EnvironmentSpec], results: Results) -> tuple[Table, ...]:
    """All tables that hold any row, in the order of the report."""
    compared = [spec for spec in specs if spec.name != "eddies"]
    plain = [spec for spec in compared if spec.name not in ("ablation", "palawan")]
    of_name = {spec.name: [spec] for spec in specs}
    made = (
        Table(
            "main",
            "Main table: all planners",
            "Baselines unpadded, as in the paper: their fuel is not to be compared with that of a "
            "padded route (see the next table). Of those that search by classes the class of least "
            "fuel is shown. Fuel is the mean over the seeds, with its standard deviation and the "
            "best seed; collisions and trials are sums over the seeds, of one turn a station. "
            "Rows of origin 'published' are the paper's; all others are computed here.",
            tuple(_main(plain, results)),
        ),
        Table(
            "equal-padding",
            "Equal padding: who needs least fuel?",
            "Every rival has Eq. 4 as its objective (the isochrone and the energy graph their own) "
            "and keeps the same padding as our route. With adaptive padding that is the padding of "
            "our best route; elsewhere the least that any of our routes kept; and on shores that "
            "none of ours passes, the least that our rule asks of a route along them. Compared "
            "with each rival's best seed, whose length, clearance and states are shown. Only here "
            "do we claim to be least.",
            tuple(_equal(compared, results)),
        ),
        Table(
            "k-sweep",
            "Number of classes k, in three orders",
            "Adaptive padding. Depth-first is the paper's order; 'fuel' is our default. Where no "
            "fuel stands, none of the first k classes of that order can be sailed.",
            tuple(_sweep(specs, results)),
        ),
        Table(
            "regret",
            "Regret of k",
            "How much more fuel the best of k classes needs than the best of all k and all orders.",
            tuple(_regret(specs, results)),
        ),
        Table(
            "ablation",
            "Ablation of the padding",
            "The scene is reconstructed. A* is the paper's, unpadded here; the paper's own was "
            "padded as its row says.",
            tuple(_main(of_name.get("ablation", []), results)),
        ),
        Table(
            "contingency",
            "Contingency manoeuvres",
            "One hard-over turn a station (the paper's count: five stations a metre on 4-gyre, "
            "and here in the single gyre and the ablation, one elsewhere), and ours: ten a metre, "
            "to both sides, in the field and in four draws of its spread. Sums over the seeds.",
            tuple(_contingency(compared, results)),
        ),
        Table(
            "palawan",
            "Palawan, two seasons",
            "Start, goal and currents are ours, so only the sides can be compared.",
            tuple(_main(of_name.get("palawan", []), results)),
        ),
        Table(
            "eddies",
            "Loss against eddy size",
            "Unpadded, one seed each. A positive figure beside ours is what the rival needs more.",
            tuple(_equal(of_name.get("eddies", []), results)),
        ),
        Table(
            "slips",
            "Slips of the published tables",
            "Published F/D beside published fuel divided by published length, where they differ by "
            "more than 2 %; and the published total of A*'s collisions.",
            tuple(slips(specs)),
        ),
    )
    return tuple(table for table in made if table.rows)


def _head(spec: EnvironmentSpec, case: Case, planner: str, origin: str) -> Row:
    """The first columns of any row."""
    return {
        "environment": spec.title,
        "scene": spec.scene,
        "case": case.title,
        "planner": planner,
        "origin": origin,
    }


def _main(specs: Sequence[EnvironmentSpec], results: Results) -> Iterator[Row]:
    """Planners of the paper's comparison, and the published rows."""
    for spec in specs:
        for case in spec.cases:
            for planner in PLANNERS.values():
                if planner.group == "fuel":
                    continue
                runs = results.of(spec, case, planner.name)
                kinds = (None,) if planner.group == "ours" else (False, True)
                for is_smoothed in kinds if runs else ():
                    form = {None: "steered", False: "original", True: "smoothed"}[is_smoothed]
                    found = Runs.of(runs, is_smoothed=is_smoothed)
                    head = _head(spec, case, planner.name, "computed")
                    yield {**head, "form": form, **found.row()}
            yield from (
                {**_head(spec, case, row.planner, "published"), **published_row(row)}
                for row in spec.published
                if row.case == case.name
            )


def _equal(specs: Sequence[EnvironmentSpec], results: Results) -> Iterator[Row]:
    """Our route and all rivals that kept its padding."""
    for spec in specs:
        for case in spec.cases:
            ours = Runs.of(results.of(spec, case, "RENEW"))
            if not ours.paths:
                continue
            least = ours.paths[0].judgement.fuel
            head = _head(spec, case, "RENEW", "computed")
            yield {**head, **_beside(ours, least)}
            for planner in PLANNERS.values():
                runs = results.of(spec, case, planner.name, "padded")
                if planner.group == "fuel" and runs:
                    head = _head(spec, case, planner.name, "computed")
                    yield {**head, **_beside(Runs.of(runs), least)}


def _beside(runs: Runs, ours: float) -> Row:
    """A rival's figures beside our fuel; positive where it needs more."""
    row = runs.row()
    if not runs.paths:
        return row
    best = min(runs.paths, key=lambda one: one.judgement.fuel)
    row |= {"length_m": best.judgement.length, "clearance_m": best.judgement.clearance}
    row["states"] = best.candidate.states
    more = float(str(row["fuel_best"])) / ours - 1
    verdict = "lost" if more < -LEAST_BY else "least" if more > LEAST_BY else "equal"
    names = ("runs", "failed", "fuel_best", "fuel", "fuel_sd", "length_m", "clearance_m", "states")
    return {
        **{name: row[name] for name in names},
        "beside_ours_percent": 100 * more,
        "ours_is": verdict if more else None,
        "steerable": row["steerable"],
        "seconds": row["seconds"],
    }


def _sweep(specs: Sequence[EnvironmentSpec], results: Results) -> Iterator[Row]:
    """Fuel of the best of k classes, by order."""
    for spec in specs:
        for order in ORDERS:
            for k, result in results.swept(spec, order):
                head = _head(spec, spec.cases[0], "RENEW", "computed")
                row = Runs.of([result]).row()
                names = ("fuel", "length_m", "clearance_m", "fuel_per_distance", "seconds")
                figures = {name: row.get(name) for name in names}
                yield {**head, "order": order, "k": k, "classes": result.routes, **figures}
        yield from (
            {
                **_head(spec, spec.cases[0], row.planner, "published"),
                "order": "depth-first",
                "k": row.classes or spec.classes,
                "fuel": row.fuel,
                "length_m": row.length,
                "clearance_m": row.clearance,
                "fuel_per_distance": row.fuel_per_distance,
            }
            for row in spec.published
            if spec.is_swept and row.planner == "RENEW" and row.case == spec.cases[0].name
        )


def _regret(specs: Sequence[EnvironmentSpec], results: Results) -> Iterator[Row]:
    """Regret of each k and order, in percent of the least fuel of all."""
    for spec in specs:
        swept = {order: results.swept(spec, order) for order in ORDERS}
        fuels = {
            (order, k): Runs.of([result]).paths[0].judgement.fuel
            for order, found in swept.items()
            for k, result in found
            if result.paths
        }
        for order in ORDERS:
            row: Row = {
                f"k={k}": 100 * (fuels[order, k] / min(fuels.values()) - 1)
                for k, _ in swept[order]
                if (order, k) in fuels
            }
            if row:
                head = _head(spec, spec.cases[0], "RENEW", "computed")
                yield {**head, "order": order, **row}


def _contingency(specs: Sequence[EnvironmentSpec], results: Results) -> Iterator[Row]:
    """Turns that met land, of all planners: as the paper counts, and as we do."""
    totals = [0, 0, 0, 0]
    for spec in specs:
        for case in spec.cases:
            for planner in PLANNERS.values():
                water = "padded" if planner.group == "fuel" else "bare"
                runs = Runs.of(results.of(spec, case, planner.name, water))
                if not runs.paths:
                    continue
                turns = [one.judgement for one in runs.paths]
                sums = [
                    sum(one.collisions for one in turns),
                    sum(one.trials for one in turns),
                    sum(one.full_collisions for one in turns),
                    sum(one.full_trials for one in turns),
                ]
                if planner.name == "RENEW" and case.padding == "adaptive":
                    totals = [a + b for a, b in zip(totals, sums, strict=True)]
                yield {
                    **_head(spec, case, planner.name, "computed"),
                    **dict(zip(_TURNS, sums, strict=True)),
                }
            yield from (
                {
                    **_head(spec, case, row.planner, "published"),
                    "collisions": row.collisions,
                    "trials": row.trials,
                }
                for row in spec.published
                if row.case == case.name and row.trials
            )
    if totals[1]:
        head: Row = {"environment": "all", "case": "adaptive padding", "planner": "RENEW"}
        yield {**head, "origin": "computed", **dict(zip(_TURNS, totals, strict=True))}


_TURNS = ("collisions", "trials", "full_collisions", "full_trials")
