from __future__ import annotations

import json
import math

import numpy as np

from pipeline.findings.text import json_value


def test_values_become_those_of_json() -> None:
    values = {
        "numbers": [np.float64(1.5), np.int64(2), math.inf, np.float64(np.nan)],
        "nested": {"flag": np.bool_(1), "nothing": None},
    }
    spelt = json.dumps(json_value(values), allow_nan=False, ensure_ascii=False)
    assert json.loads(spelt.encode()) == {
        "numbers": [1.5, 2, None, None],
        "nested": {"flag": True, "nothing": None},
    }
