"""Files of JSON, and values that JSON can hold."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np


def write_json(path: Path, content: object, indent: int | None = 2) -> None:
    """Write a new file of JSON (UTF-8), with `null` for numbers that are not finite."""
    text = json.dumps(json_value(content), indent=indent, ensure_ascii=False, allow_nan=False)
    path.write_text(f"{text}\n", encoding="utf-8")


def json_value(value: Any) -> Any:  # noqa: ANN401 - any value in, one that JSON knows out
    """Make a value, with all that is nested in it, one that JSON can hold.

    NumPy's types become Python's, numbers that are not finite None, and texts encodable.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return encodable_text(value)
    if isinstance(value, dict):
        return {key: json_value(item) for key, item in value.items()}
    if isinstance(value, list):
        return [json_value(item) for item in value]
    return value


def encodable_text(text: str) -> str:
    """Replace lone halves of a surrogate pair, which no encoding has, by U+FFFD."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
