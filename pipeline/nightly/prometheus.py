"""A night's metrics for monitoring, in a text file that Prometheus' node exporter reads.

Format: https://prometheus.io/docs/instrumenting/exposition_formats/ (text, version 0.0.4). The file
has timestamps instead of ages: the monitoring system computes an age as `time() - ...`, which stays
correct if the file is not updated.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.machine.files import whole_file
from pipeline.nightly.outcome import NightOutcome

if TYPE_CHECKING:
    from prometheus_client import CollectorRegistry

SUCCESSES = frozenset({0, 10})
"""Exit codes of a night that published its cycle, or had nothing to do."""

_LAST_SUCCESS = "renew_nightly_last_success_timestamp_seconds"
_FORECAST = "renew_nightly_forecast_reference_timestamp_seconds"
_HELP = {
    _LAST_SUCCESS: "End of the last night that published its cases or had nothing to do.",
    _FORECAST: "Reference time of the currents of the last successful night.",
    "renew_nightly_last_run_timestamp_seconds": "End of the last night, successful or not.",
    "renew_nightly_last_exit_code": "Exit code of the last night; 0 and 10 are successes.",
    "renew_nightly_stage_seconds": "Wall time of each stage of the last night.",
    "renew_nightly_cases": "Cases of the last night, by how they ended.",
}


def write_metrics(path: Path, outcome: NightOutcome) -> str:
    """Replace the file atomically with the metrics of a night; return "" or why that failed.

    After a failed night the timestamps of the last success stay unchanged. The caller does not call
    this for a job that ended because another one was running (exit code 4).
    """
    from prometheus_client import generate_latest

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write(generate_latest(_registry(outcome, _last_success(path))))
    except OSError as error:
        return f"--metrics: can't write {path}: {error.strerror or error}"
    return ""


def _registry(outcome: NightOutcome, earlier: Mapping[str, float]) -> CollectorRegistry:
    """Return the metrics of a night; `earlier` has the timestamps of the last success before it."""
    from prometheus_client import CollectorRegistry, Gauge

    times = dict(earlier)
    if outcome.exit_code in SUCCESSES:
        times[_LAST_SUCCESS] = outcome.finished.timestamp()
        if outcome.reference_time is not None:
            times[_FORECAST] = outcome.reference_time.timestamp()
    times["renew_nightly_last_run_timestamp_seconds"] = outcome.finished.timestamp()
    single = {**times, "renew_nightly_last_exit_code": outcome.exit_code}
    registry = CollectorRegistry()
    for name, value in single.items():
        Gauge(name, _HELP[name], registry=registry).set(value)
    for name, label, values in (
        ("renew_nightly_stage_seconds", "stage", outcome.seconds_by_stage),
        ("renew_nightly_cases", "outcome", outcome.cases_by_outcome),
    ):
        gauge = Gauge(name, _HELP[name], [label], registry=registry)
        for key, number in values.items():
            gauge.labels(key).set(round(number, 3))
    return registry


def _last_success(path: Path) -> dict[str, float]:
    """Return the timestamps of the last success in an earlier file; {} if it can't be read."""
    from prometheus_client.parser import text_string_to_metric_families

    try:
        families = list(text_string_to_metric_families(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}
    return {
        one.name: one.samples[0].value for one in families if one.name in {_LAST_SUCCESS, _FORECAST}
    }
