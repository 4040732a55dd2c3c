"""The compiled feel model by itself, cycle by cycle, as theory is held against it; for tests only."""

from typing import Any

import numpy as np

from cls_bench.feel import solver
from cls_bench.feel.element import PIECE
from cls_bench.feel.model import STATE
from cls_bench.parameters import Parameters, record_of
from cls_bench.parameters.override import override

CYCLE = 400e-6


class Model:
    """The feel model of ``feel`` (a table of parameters), settled with its bodies at rest where they are put."""

    def __init__(self, feel: dict[str, Any], column: float = 0.0, aft: float | None = None, *, forward: float = 0.0):
        p = override(Parameters(), {"feel": feel})
        p = override(p, {"feel.inertia": p.feel.inertia + forward})
        self.feel = p.feel
        self._record = record_of(p).feel
        self.state: Any = np.zeros(1, dtype=STATE).view(np.recarray)[0]
        self._piece: Any = np.zeros(1, dtype=PIECE).view(np.recarray)[0]
        self.state.angle, self.state.aft_angle = column, column if aft is None else aft
        self.state.autopilot.engaged = float(self.feel.autopilot.engaged)
        self.state.autopilot.reference = self.feel.autopilot.reference
        self.state.pusher.level = self.feel.pusher.torque if self.feel.pusher.engaged else 0.0
        self._cycles = 0

    def step(self, torque: float = 0.0) -> float:
        """The column's angle [rad] after a cycle under a torque [N·m]."""
        solver.step(self._record, self.state, self._piece, torque, self._cycles * CYCLE, CYCLE)
        self._cycles += 1
        return float(self.state.angle)

    def swept(self, top: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Column angle [rad] and torque [N·m] in means of 20 ms, as a stiff hand leads it to ±``top`` and back."""
        n, begin = round(top / speed / CYCLE), float(self.state.angle)
        wanted = begin + np.concatenate(
            [np.linspace(0.0, top, n), np.linspace(top, -top, 2 * n), np.linspace(-top, 0.0, n)]
        )
        rates = np.repeat([speed, -speed, -speed, speed], n)
        angle, torque = np.empty(len(wanted)), np.empty(len(wanted))
        for k, (x, v) in enumerate(zip(wanted, rates, strict=True)):
            torque[k] = 3000.0 * (x - self.state.angle) + 25.0 * (v - self.state.velocity)
            angle[k] = self.step(torque[k])
        whole = len(angle) // 50 * 50
        return angle[:whole].reshape(-1, 50).mean(axis=1), torque[:whole].reshape(-1, 50).mean(axis=1)


TWO: dict[str, Any] = {"bodies": "two"}

MODELS: dict[str, dict[str, Any]] = {
    "one": {},
    "two": TWO,
    "two without friction": {**TWO, "friction": 0.0, "aft": {"friction": 0.0}},
    "backlash": {**TWO, "linkage": {"backlash": 0.02}},
    "backlash without damping": {**TWO, "linkage": {"backlash": 0.02, "damping": 0.0}},
    "slack cables": {**TWO, "linkage": {"pretension": 4.0, "backlash": 0.005}},
    "override": {**TWO, "linkage": {"override": 3.0}},
    "jam aft with override": {**TWO, "linkage": {"override": 3.0}, "jam": {"of": "aft"}},
    "disconnected": {**TWO, "linkage": {"connected": False}},
    "stribeck": {**TWO, "static_friction": 0.6, "stribeck_velocity": 0.05,
                 "aft": {"static_friction": 0.9, "stribeck_velocity": 0.02}},
    "static friction": {**TWO, "static_friction": 0.6, "aft": {"static_friction": 0.9}},
    "detents": {"detents": {"place": (0.0, 0.1), "width": (0.06, 0.05), "torque": (2.0, 1.0)}},
    "detents aft": {**TWO, "detents": {"place": (0.0, 0.1), "width": (0.06, 0.05), "torque": (2.0, 1.0)}},
    "detent by profile": {**TWO, "detents": {"place": (0.0,), "width": (0.06,), "torque": (2.0,),
                                             "profile": (0.0, 1.0, 0.5, -0.5, -1.0, 0.0)}},
    "surface": {**TWO, "stiffness": 5.0,
                "flight": {"dynamic_pressure": 3000.0, "airspeed": 70.0, "angle_of_attack": 0.05, "tab": -0.02},
                "surface": {"area": 1.0, "chord": 0.3, "hinge_deflection": -0.1, "hinge_alpha": -0.05,
                            "hinge_tab": -0.03, "hinge_zero": 0.002, "hinge_rate": -3.0, "boost": 0.4,
                            "control_angle": (-0.3, -0.1, 0.05, 0.3), "deflection": (-0.5, -0.1, 0.04, 0.4)},
                "hydraulics": {"pressure": 0.5, "feel_share": 0.7, "off_friction": 0.3, "off_damping": 0.7,
                               "maximum_rate": 0.5}},
    "autopilot": {**TWO, "autopilot": {"engaged": True, "reference": 0.05, "clutch": 3.0, "torque": 0.2}},
    "weights and springs": {
        "neutral": 0.03, "flight": {"load_factor": 1.5, "dynamic_pressure": 2000.0},
        "unbalance": {"torque": 0.5, "gradient": 3.0, "level": 0.02}, "bob_weight": {"torque": 0.4},
        "down_spring": {"torque": -0.3}, "pusher": {"engaged": True, "torque": 0.5}, "disturbance": {"torque": 0.1},
        "q_feel": {"gradient": 0.01, "most": 15.0}, "centering": {"stiffness": 80.0, "breakout": 0.8},
    },
    "force trim released": {**TWO, "trim": {"released": True}, "unbalance": {"gradient": -8.0}},
    "limits to either side": {
        **TWO, "forward_limit": {"angle": 0.12, "back_angle": 0.1, "stiffness": 1500.0, "damping": 20.0},
        "aft_limit": {"angle": 0.10, "back_angle": 0.05, "stiffness": 800.0, "damping": 30.0},
    },
}  # fmt: skip
"""Every element in some feel model, as tables of parameters."""
