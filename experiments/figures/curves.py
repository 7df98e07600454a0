"""Curves: turning circles with the distribution of their reach, fuel against time, eddies."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

import renew
from experiments.baselines.registry import PLANNERS
from experiments.environments.model import EnvironmentSpec
from experiments.plan_of_jobs import TIMED
from experiments.tables.summary import Runs
from experiments.tables.tables import Results
from pipeline.formats.appearance import COLOURS
from renew._types import FloatArray
from renew.turns.turn_reach import turn_reach

_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00")

# The example's inputs are ours: those of the published one are not in the paper.
# Its current at 45 degrees to the edge, m/s.
_SPEED = 0.30
# Spread of the current's speed, as a share of it.
_SPEED_SPREAD = 0.1
# Spread of the current's direction, rad.
_DIRECTION_SPREAD = np.radians(10)
# Number of draws.
_DRAWS = 20_000
_RISK = 0.05
# Marks on the axis of fuel beside ours, percent.
_PERCENTS = (-0.5, 0, 0.5, 1, 2, 5)
# Published paddings of the example, m: towards the edge, and away from it.
_PUBLISHED = (4.47, 1.96)


def turning_circles(vessel: renew.Vessel) -> Figure:
    """Hard-over turns beside an edge, and how far drawn ones reach towards it."""
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.axhline(0, color=COLOURS["coast"], lw=2)
    left.annotate("edge of the no-go zone", (-3.8, 0.2), fontsize=8)
    rng = np.random.default_rng(0)
    samples: list[tuple[str, FloatArray, str]] = []
    signs = (("towards the edge", 1.0), ("away from the edge", -1.0))
    for (name, sign), published, colour in zip(signs, _PUBLISHED, _COLOURS, strict=False):
        angle = sign * np.pi / 4 + rng.normal(0, _DIRECTION_SPREAD, _DRAWS)
        speed = _SPEED * np.maximum(0.0, 1 + rng.normal(0, _SPEED_SPREAD, _DRAWS))
        current = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        reach = turn_reach(vessel, np.zeros(_DRAWS), current, np.array([0.0, 1.0]))
        padding = float(np.quantile(reach, 1 - _RISK))
        middle = _SPEED * np.array([np.cos(np.pi / 4), sign * np.sin(np.pi / 4)])
        plain = float(turn_reach(vessel, np.asarray(0.0), middle, np.array([0.0, 1.0])))
        label = (
            f"{name}: {padding:.2f} m; without spread {plain:.2f} m (published {published:.2f} m)"
        )
        samples.append((label, reach, colour))
        right.axvline(padding, color=colour, ls=":", lw=1)
        for side in (1, -1):
            track = _turn(vessel, middle, side) - [0.0, padding]
            style = "-" if side > 0 else "--"
            left.plot(*track.T, color=colour, ls=style, label=f"_{name}")
        left.plot([], [], color=colour, label=f"current {name}, starting at its padding")
    left.set(aspect="equal", xlabel="along the edge (m)", ylabel="m from the edge", xlim=(-4, 8))
    left.set_title("Hard-over turns in 0.30 m/s at 45° to the edge", fontsize=10, loc="left")
    left.set_ylim(-7.5, 1.2)
    left.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False)
    for label, reach, colour in samples:
        right.plot(np.sort(reach), np.arange(1, _DRAWS + 1) / _DRAWS, color=colour, label=label)
    right.axhline(1 - _RISK, color=COLOURS["frame"], lw=0.8, ls="--")
    right.set(xlabel="reach towards the edge (m)", ylabel="share of drawn turns")
    right.set_title(
        "Reach of drawn turns: the padding is the 95 % quantile", fontsize=10, loc="left"
    )
    right.set_ylim(-0.02, 1.05)
    right.legend(
        fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), title="current", frameon=False
    )
    return figure


def _turn(vessel: renew.Vessel, current: FloatArray, side: int) -> FloatArray:
    """Track (n, 2) of a full turn from the origin, heading along x, in a steady current."""
    t = np.linspace(0, vessel.turn_period, 200)[:, None]
    angle = vessel.turn_rate * t
    circle = vessel.turning_radius * np.hstack([np.sin(angle), side * (1 - np.cos(angle))])
    return np.asarray(circle + t * current)


def fuel_against_seconds(spec: EnvironmentSpec, results: Results) -> Figure | None:
    """Fuel at equal padding against CPU time: medians and quartiles over the seeds."""
    if spec.name != TIMED:
        return None
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    for axes, case in zip(figure.subplots(1, len(spec.cases)), spec.cases, strict=True):
        fuel = [planner for planner in PLANNERS.values() if planner.group == "fuel"]
        for planner, colour in zip(fuel, _COLOURS, strict=True):
            budgets = results.by_budget(spec, case, planner.name, "padded")
            found = [Runs.of(runs).paths for _, runs in sorted(budgets.items())]
            points = np.array(
                [
                    [
                        np.median([one.candidate.seconds for one in paths]),
                        *np.quantile([one.judgement.fuel for one in paths], [0.25, 0.5, 0.75]),
                    ]
                    for paths in found
                    if paths
                ]
            ).reshape(-1, 4)
            spread = np.abs(points[:, [1, 3]] - points[:, [2, 2]]).T
            axes.errorbar(
                points[:, 0], points[:, 2], spread, fmt="o-", ms=4, capsize=3,
                color=colour, label=planner.name,
            )  # fmt: skip
        for one in Runs.of(results.of(spec, case, "RENEW")).paths:
            at = (one.candidate.seconds, one.judgement.fuel)
            axes.plot(*at, "*", ms=13, color=COLOURS["best"], label="RENEW, k = 16")
            axes.axhline(at[1], color=COLOURS["best"], lw=0.8, ls=":")
        axes.set(xscale="log", xlabel="CPU time (s)", ylabel="fuel")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(f"{spec.title}, {case.title}", fontsize=10, loc="left")
        axes.legend(fontsize=8)
    return figure


def loss_against_size(spec: EnvironmentSpec, results: Results) -> Figure:
    """How much more fuel each rival's best seed needs than our route, by the eddies' size."""
    figure = Figure(figsize=(9.5, 4.4), layout="constrained")
    axes = figure.subplots()
    fuel = [planner for planner in PLANNERS.values() if planner.group == "fuel"]
    for planner, colour in zip(fuel, _COLOURS, strict=True):
        shares = []
        for number, case in enumerate(spec.cases):
            ours = Runs.of(results.of(spec, case, "RENEW")).paths
            theirs = Runs.of(results.of(spec, case, planner.name, "padded")).paths
            if ours and theirs:
                least = min(one.judgement.fuel for one in theirs)
                shares.append((number, 100 * (least / ours[0].judgement.fuel - 1)))
        axes.plot(*np.array(shares).reshape(-1, 2).T, "o-", ms=4, color=colour, label=planner.name)
    axes.axhline(0, color=COLOURS["best"], lw=1.2, label="RENEW")
    axes.set_xticks(range(len(spec.cases)), [case.title for case in spec.cases], fontsize=8)
    axes.set(xlabel="half-wave of the eddies", ylabel="more fuel than RENEW (%)")
    axes.set_yscale("symlog", linthresh=1)
    axes.set_yticks(_PERCENTS, [f"{percent:g}" for percent in _PERCENTS])
    axes.grid(axis="y", color=COLOURS["grid"], lw=0.6)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure
