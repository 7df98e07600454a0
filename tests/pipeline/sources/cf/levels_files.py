"""S-104 files made up for tests.

The structure is that of NOAA's files of edition 2.0; that of edition 1.1 is from the standard's
text.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pipeline._types import FloatArray

FILL = -9999.0


def write_s104(
    path: Path,
    axes: tuple[FloatArray, FloatArray],
    instants_s: FloatArray,
    levels_m: FloatArray,
    **about: object,
) -> Path:
    """Write levels (nt, ny, nx), m, NaN where there is none, on axes lon, lat, degrees.

    `about` are attributes of the file. Without them it is of edition 2.0, over MLLW.
    """
    given = {"productSpecification": "INT.IHO.S-104.2.0", "verticalDatum": np.int32(12), **about}
    is_new = str(given["productSpecification"]).endswith("2.0")
    given |= {"issueDate": "20261122", "issueTime": "120000Z", "geographicIdentifier": "A bay"}
    given |= {"horizontalCRS" if is_new else "horizontalDatumValue": np.int32(4326)} | about
    fields = ("code", "name", "uom.name", "fillValue", "datatype", "lower", "upper", "closure")
    rows = [
        ("waterLevelHeight", "Height", "metre", f"{FILL:.2f}", "H5T_FLOAT", "-99.99", "99.99", ""),
        ("waterLevelTrend", "Trend", "", "0", "H5T_ENUM", "", "", ""),
    ]
    text: Any = h5py.string_dtype() if is_new else "S50"
    with h5py.File(path, "w") as file:
        file.attrs.update(given)
        described = np.array(rows, dtype=[(name, text) for name in fields])
        file.create_dataset("Group_F/WaterLevel", data=described)
        feature = file.create_group("WaterLevel")
        feature.attrs["dataCodingFormat"] = np.uint8(2)
        instance = feature.create_group("WaterLevel.01")
        instance.attrs["startSequence"] = "0,0"
        for name, axis in zip(("Longitud", "Latitud"), axes, strict=True):
            instance.attrs[f"gridOrigin{name}e"] = axis[0]
            instance.attrs[f"gridSpacing{name}inal"] = axis[1] - axis[0]
            instance.attrs[f"numPoints{name}inal"] = axis.size
        for number, (instant, level) in enumerate(zip(instants_s, levels_m, strict=True), 1):
            values = np.zeros(level.shape, [("waterLevelHeight", "<f4"), ("waterLevelTrend", "u1")])
            values["waterLevelHeight"] = np.where(np.isfinite(level), level, FILL)
            group = instance.create_group(f"Group_{number:03}")
            group.attrs["timePoint"] = f"{datetime.fromtimestamp(instant, UTC):%Y%m%dT%H%M%SZ}"
            group.create_dataset("values", data=values)
    return path
