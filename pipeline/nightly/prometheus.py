"""A night's figures for a monitoring system: a text file that Prometheus' node exporter reads.

Format: https://prometheus.io/docs/instrumenting/exposition_formats/ (text, version 0.0.4). Times
are given as times, not as ages: an age grows while nobody writes the file, and the monitoring
system works it out as `time() - ...`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from pipeline.nightly.outcome import NightOutcome
from pipeline.storage.whole_files import write_whole

SUCCESSES = frozenset({0, 10})
"""Exit codes of a night that published its cycle, or had nothing to do."""

_LAST_SUCCESS = "renew_nightly_last_success_timestamp_seconds"
_FORECAST = "renew_nightly_forecast_reference_timestamp_seconds"
_HELP = {
    _LAST_SUCCESS: "When a night last ended with all its cases published or nothing to do.",
    _FORECAST: "Reference time of the currents of the last successful night.",
    "renew_nightly_last_run_timestamp_seconds": "When the last night ended, however it did.",
    "renew_nightly_last_exit_code": "Exit code of the last night; 0 and 10 are successes.",
    "renew_nightly_stage_seconds": "Wall time of each stage of the last night.",
    "renew_nightly_cases": "Cases of the last night, by how they ended.",
}


def write_metrics(path: Path, outcome: NightOutcome) -> str:
    """Replace the file at once by the figures of a night; "" or why that could not be done.

    After a night that failed, the times of the last success stay as they were. A job that left
    because another one is at work (exit code 4) has no figures: the other writes them.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = "".join(_families(outcome, _earlier(path)))
        write_whole(path, text)
    except OSError as error:
        return f"--metrics: can't write {path}: {error.strerror or error}"
    return ""


def _families(outcome: NightOutcome, earlier: Mapping[str, str]) -> Iterator[str]:
    """Yield the families of metrics: their help, their type, and a line for each value."""
    values: dict[str, dict[str, object]] = {name: {} for name in _HELP}
    if outcome.exit_code in SUCCESSES:
        values[_LAST_SUCCESS][""] = outcome.finished.timestamp()
        if outcome.reference_time is not None:
            values[_FORECAST][""] = outcome.reference_time.timestamp()
    else:
        for name in (_LAST_SUCCESS, _FORECAST):
            if name in earlier:
                values[name][""] = earlier[name]
    values["renew_nightly_last_run_timestamp_seconds"][""] = outcome.finished.timestamp()
    values["renew_nightly_last_exit_code"][""] = outcome.exit_code
    for stage, seconds in outcome.seconds_by_stage.items():
        values["renew_nightly_stage_seconds"][_label("stage", stage)] = round(seconds, 3)
    for how, number in outcome.cases_by_outcome.items():
        values["renew_nightly_cases"][_label("outcome", how)] = number
    for name, lines in values.items():
        if lines:
            yield f"# HELP {name} {_HELP[name]}\n# TYPE {name} gauge\n"
            yield from (f"{name}{label} {value}\n" for label, value in lines.items())


def _label(name: str, value: str) -> str:
    """A metric's label, its value escaped as the format asks."""
    escaped = value.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
    return f'{{{name}="{escaped}"}}'


def _earlier(path: Path) -> dict[str, str]:
    """Times that an earlier file gives, as it spells them; none where there is no such file."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return {}
    names = f"{_LAST_SUCCESS}|{_FORECAST}"
    return dict(re.findall(rf"^({names}) ([0-9.e+]+)$", text, re.MULTILINE))
