"""Bayesian Eigenobjects: class, pose and completed shape of partial voxel grids, on NumPy arrays and over shared memory.

Grids are arrays [x][y][z], z up. Partial grids are uint8: 0 empty, 1 filled, 255 unknown; complete shapes are uint8 or bool: 1 filled.
Quaternions are x, y, z, w. Arguments that make no sense raise TypeError or ValueError, what the system refuses OSError, each with what was
wrong and what to do.
"""

from ._beo import (
    CarvedGrid,
    Hypothesis,
    Model,
    Observer,
    Percept,
    PublishedPercept,
    Subscriber,
    __version__,
    carve,
    household_shape,
    read_shape,
    segment,
    view_from_above,
)

__all__ = [
    "CarvedGrid",
    "Hypothesis",
    "Model",
    "Observer",
    "Percept",
    "PublishedPercept",
    "Subscriber",
    "__version__",
    "carve",
    "household_shape",
    "read_shape",
    "segment",
    "view_from_above",
]
