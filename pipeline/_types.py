"""Types of arrays, equal to the planner's, which is slow to import, and of files by xarray."""

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

ArrayLike: TypeAlias = npt.ArrayLike
FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
IndexArray: TypeAlias = npt.NDArray[np.intp]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
Geometries: TypeAlias = npt.NDArray[np.object_]

if TYPE_CHECKING:
    import xarray as xr

    Dataset: TypeAlias = xr.Dataset
    DataArray: TypeAlias = xr.DataArray
    Variable: TypeAlias = xr.Variable
else:  # importing it is slow, and many runs read no such files
    Dataset = DataArray = Variable = Any
