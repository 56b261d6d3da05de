"""Types of arrays and of random numbers."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Times = NDArray[np.int64]
Rng = np.random.Generator
