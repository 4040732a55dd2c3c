"""What the plant's tests share: the whole bench run from a scenario text, and single elements cut out of its model."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from cls_bench.bench import Bench
from cls_bench.parameters import Parameters, record_of
from cls_bench.plant import model as plant_model
from cls_bench.plant import state
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TICK_S, TOPIC

HEAD = 'title = "test"\nseed = 3\n'


class Run:
    """A scenario run to its end: ``run["/column.angle"]`` is a signal, ``run.time("/column")`` its times [s]."""

    def __init__(self, toml: str, *overrides: str):
        scenario = parse_scenario(HEAD + toml, set=overrides)
        self.bench = Bench(scenario.parameters_at_start(), seed=scenario.seed)
        blocks = list(self.bench.run(scenario))
        self.events = [event for block in blocks for event in block.events]
        self.rows = {path: np.concatenate([block.signals[path] for block in blocks]) for path in TOPIC}

    def __getitem__(self, signal: str) -> Any:
        path, name = signal.rsplit(".", 1)
        return self.rows[path][:, TOPIC[path].names.index(name)]

    def time(self, path: str) -> Any:
        return np.arange(len(self.rows[path])) * TOPIC[path].ticks * TICK_S

    def during(self, signal: str, start: float, end: float) -> Any:
        """The part of a signal from ``start`` to ``end`` [s]."""
        t = self.time(signal.rsplit(".", 1)[0])
        return self[signal][(t >= start) & (t < end)]


class Element:
    """A part of the bench alone, without gravity: its model, its memory and the laws' view of it."""

    def __init__(self, parameters: Parameters, joints: Sequence[str], parts: Sequence[str] = ()):
        self.parameters = parameters
        self.record = record_of(parameters)
        self.dampings = plant_model.dampings(parameters)
        self.model: Any = plant_model.element_spec(parameters, joints, parts).compile()
        self.model.opt.gravity[:] = 0.0
        self.data: Any = mujoco.MjData(self.model)
        self.plant = state.memory(self.model, self.data)

    def load(self, joint: int, inertia: float) -> None:
        """Add inertia [kg·m²] to a joint; a huge one holds it."""
        self.model.dof_armature[joint] += inertia
        mujoco.mj_setConst(self.model, self.data)

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)


def parameters(**sections: dict[str, Any]) -> Parameters:
    """Parameters with some values changed: ``parameters(motor={"cogging_amplitude": 0.1})``."""
    return Parameters.model_validate(
        {
            name: {**getattr(Parameters(), name).model_dump(), **values}
            for name, values in sections.items()
        }
    )
