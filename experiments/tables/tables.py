"""All tables of the report from the results of all runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from experiments.baselines.registry import PLANNERS
from experiments.environments.loading import Environment
from experiments.environments.model import Case, EnvironmentSpec, Published
from experiments.jobs import Result
from experiments.plan_of_jobs import ORDERS
from experiments.tables.summary import Row, Runs, Table

LEAST_BY = 1e-3
"""Share by which a rival may undercut our fuel before it is said that we lose: 0.1 %."""

# Share by which a published F/D may differ from fuel / length: three digits, and means of ratios.
_SLIP = 0.02
# The total of A*'s collisions as it is printed; its rows are in the catalogue.
_PRINTED_A_STAR_COLLISIONS = 128
_TURNS = ("collisions", "trials", "full_collisions", "full_trials")


class Results:
    """Results by environment, case, planner and water."""

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


@dataclass(frozen=True)
class Findings:
    """What a run gave: environments, results, tables made of them, and facts about the run."""

    environments: tuple[Environment, ...]
    results: Results
    tables: tuple[Table, ...]
    facts: dict[str, str]


def tables(specs: Sequence[EnvironmentSpec], results: Results) -> tuple[Table, ...]:
    """All tables that hold any row, in the order of the report."""
    compared = [spec for spec in specs if spec.name != "eddies"]
    plain = [spec for spec in compared if spec.name != "ablation" and not spec.island]
    of_name = {spec.name: [spec] for spec in specs}
    made = (
        Table("main", tuple(_main(plain, results))),
        Table("equal-padding", tuple(_equal(compared, results))),
        Table("k-sweep", tuple(_sweep(specs, results))),
        Table("regret", tuple(_regret(specs, results))),
        Table("ablation", tuple(_main(of_name.get("ablation", []), results))),
        Table("contingency", tuple(_contingency(compared, results))),
        Table("palawan", tuple(_main([spec for spec in specs if spec.island], results))),
        Table("eddies", tuple(_equal(of_name.get("eddies", []), results))),
        Table("slips", tuple(_slips(specs))),
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
                {**_head(spec, case, row.planner, "published"), **_published_row(row)}
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
                sums = [sum(getattr(one.judgement, name) for one in runs.paths) for name in _TURNS]
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


def _published_row(row: Published) -> Row:
    """A published row with our columns; what was not published is left out."""
    figures: Row = {
        "form": "smoothed" if row.smoothed else "original",
        "fuel": row.fuel,
        "clearance_m": row.clearance,
        "fuel_per_distance": row.fuel_per_distance,
        "states": row.states,
        "length_m": row.length,
        "collisions": row.collisions,
        "trials": row.trials,
    }
    if row.classes:
        figures["form"] = f"k = {row.classes}"
    if row.side:
        figures["side"] = row.side
    return {name: value for name, value in figures.items() if value is not None}


def _slips(specs: Sequence[EnvironmentSpec]) -> Iterator[Row]:
    """Published figures that contradict each other."""
    for spec in specs:
        for row in spec.published:
            ratio = row.fuel / row.length
            if row.fuel_per_distance and abs(row.fuel_per_distance / ratio - 1) > _SLIP:
                yield {
                    "environment": spec.title,
                    "planner": row.planner,
                    "figure": "F/D",
                    "printed": row.fuel_per_distance,
                    "from_its_rows": ratio,
                }
    collisions = [
        row.collisions
        for spec in specs
        for row in spec.published
        if row.planner == "A*" and row.collisions is not None
    ]
    if len(collisions) == 3:
        yield {
            "environment": "4-gyre, Hansando, Far East",
            "planner": "A*",
            "figure": "sum of collisions",
            "printed": _PRINTED_A_STAR_COLLISIONS,
            "from_its_rows": sum(collisions),
        }
