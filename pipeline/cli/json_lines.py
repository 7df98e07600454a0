"""A log with one JSON object per line, without credentials."""

from collections.abc import MutableMapping
from typing import Any, TextIO

from pipeline.sources.copernicus.account import without_secrets


def json_lines(stream: TextIO) -> Any:  # noqa: ANN401 - a structlog logger, typed as it is bound
    """Return a logger that writes each event to a stream as a line of JSON."""
    import structlog

    return structlog.wrap_logger(
        structlog.WriteLogger(stream),
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            _hide_secrets,
            structlog.processors.JSONRenderer(ensure_ascii=False),
        ],
    )


def _hide_secrets(
    logger: object, method: str, fields: MutableMapping[str, Any]
) -> MutableMapping[str, Any]:
    """Hide credentials in every text of an event; a message may quote an address or a reply."""
    del logger, method
    return {name: _hidden(value) for name, value in fields.items()}


def _hidden(value: object) -> object:
    """Return the value with credentials hidden in its texts."""
    if isinstance(value, str):
        return without_secrets(value)
    if isinstance(value, dict):
        return {name: _hidden(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_hidden(one) for one in value]
    return value
