"""What the bench is told of the pilot: the hand, tick by tick."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HandSamples:
    """What the hand does in a run of consecutive ticks: one entry a tick."""

    angle: Array
    """column angle at which the arm wants the forearm's mass [rad]"""
    velocity: Array
    """its time derivative [rad/s]; 0 across a step"""
    force: Array
    """force on the forearm's mass at the grip [N], positive forward"""
    motion: NDArray[np.bool_]
    """whether the arm follows :attr:`angle`; otherwise only :attr:`force` acts"""
    attached: NDArray[np.bool_]
    """whether the hand grips"""
    squeeze: Array
    """how tightly it grips: 0 loose, 1 tight"""
