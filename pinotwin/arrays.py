"""Names for arrays, so that a signature says what kind of number it takes.

Times run down the rows. Shapes are given in the docstrings: ``n`` samples, ``nv`` joints of the model,
``p`` parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]
