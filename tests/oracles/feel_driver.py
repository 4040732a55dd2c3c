"""Runs the feel model alone, cycle by cycle, as the PLC does."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cls_bench.feel import solver
from cls_bench.feel.element import PIECE
from cls_bench.feel.model import STATE
from cls_bench.parameters import Feel, Parameters, record_of

CYCLE = 4e-4
"""Cycle of the default PLC [s]."""

FREE = {"stiffness": 0.0, "damping": 0.0, "friction": 0.0}
"""A body that nothing acts on, within its travel limits."""

COLUMNS = ("angle", "velocity", "aft_angle", "aft_velocity")


def blank(dtype: np.dtype[Any]) -> Any:
    """One record of zeros, its fields as attributes."""
    return np.zeros(1, dtype=dtype).view(np.recarray)[0]


def record(feel: Feel) -> Any:
    """Parameters of a feel model as compiled code takes them."""
    return record_of(Parameters(feel=feel)).feel


def feel_of(values: Mapping[str, Any]) -> Feel:
    """A feel model by dotted keys: ``{"bodies": "two", "linkage.backlash": 0.02}``; the others are the defaults."""
    tree: dict[str, Any] = Feel().model_dump()
    for key, value in values.items():
        section = tree
        *path, name = key.split(".")
        for part in path:
            section = section[part]
        assert name in section, key
        section[name] = value
    return Feel.model_validate(tree)


class Model:
    """A feel model and its state."""

    def __init__(self, feel: Feel, start: Sequence[float] = (0.0, 0.0, 0.0, 0.0)):
        self.state, self.piece = blank(STATE), blank(PIECE)
        self.set(feel)
        for name, value in zip(COLUMNS, start, strict=False):
            setattr(self.state, name, value)
        self.time = 0.0
        self.cycles = 0

    def set(self, feel: Feel) -> None:
        """Change the parameters."""
        self.feel = record(feel)

    def step(self, torque: float = 0.0, cycle: float = CYCLE) -> None:
        """One cycle under the pilot's torque [N·m]."""
        solver.step(self.feel, self.state, self.piece, torque, self.cycles * cycle, cycle)
        self.cycles += 1


def motion(
    feel: Feel | Sequence[tuple[int, Feel]], torque: float | Sequence[float], cycles: int,
    start: Sequence[float] = (0.0, 0.0, 0.0, 0.0), *, cycle: float = CYCLE,
    white: Sequence[float] | None = None, of: Callable[[Any], Any] | None = None,
) -> NDArray[np.float64]:  # fmt: skip
    """Angle, velocity, aft angle and aft velocity at the end of each cycle, a row each, or what ``of`` the state says.

    ``feel`` may be a sequence of (first cycle, model), for parameters that change in mid-run.
    """
    changes = [(0, feel)] if isinstance(feel, Feel) else list(feel)
    model = Model(changes[0][1], start)
    at = dict(changes)
    numbers = np.frombuffer(model.state, dtype=float)[: STATE.names.index("torque")]  # all of them are
    rows = []
    for k in range(cycles):
        if k in at:
            model.set(at[k])
        if white is not None:
            model.state.gust.white = white[k]
        model.step(torque if isinstance(torque, (int, float)) else torque[k], cycle)
        rows.append(numbers.copy() if of is None else of(model.state))
    found = np.array(rows, dtype=float)
    return found if of is not None else found[:, [STATE.names.index(name) for name in COLUMNS]]
