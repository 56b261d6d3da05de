"""Types of arrays and of random numbers: Array holds float64 and Floats float32, which the stubs of NumPy cannot follow."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Floats = NDArray[Any]
Ints = NDArray[np.int32]
Times = NDArray[np.int64]
Rng = np.random.Generator
Trajectory = Callable[[Times], Array]
