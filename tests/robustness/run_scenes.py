"""Plans odd scenes in a process of its own, whose memory is limited; prints the outcome as JSON."""

from __future__ import annotations

import collections
import json
import sys
import warnings

import renew
from tests.robustness.limits import TooSlowError, cpu_limit, failure, limit_memory
from tests.robustness.scenes import broken_promises, odd_scene

SEED = 20_260_111


def outcomes(cases: range) -> tuple[list[str], dict[str, int]]:
    """Plan scenes: descriptions of failures, and how often each outcome was met."""
    failures: list[str] = []
    met: collections.Counter[str] = collections.Counter()
    for case in cases:
        try:
            with cpu_limit():
                scene = odd_scene([SEED, case])
                chart, plan = scene.plan()
                broken = broken_promises(scene, chart, plan)
            failures += [f"case {case}: {promise}" for promise in broken]
            met["plan"] += 1
        except renew.PlanningError as error:
            met[type(error).__name__] += 1
            if not str(error).strip():
                failures.append(f"case {case}: a {type(error).__name__} without words")
        except (Exception, TooSlowError) as error:  # noqa: BLE001 - what must not happen
            failures.append(failure(case, error))
    return failures, met


if __name__ == "__main__":
    warnings.simplefilter("error")
    limit_memory()
    found, counts = outcomes(range(int(sys.argv[1]), int(sys.argv[2])))
    sys.stdout.write(json.dumps({"failures": found, "met": counts}))
