"""The whole rig as MuJoCo steps it from its MJCF: closing constraint, tendons, LuGre actuators.

It shares the parameters with what is stepped and none of its laws. MuJoCo has no backlash around a transmission error,
no damper that a spring bounds and no friction that follows a load, so dead zones, damping and friction levels of its
elements are set before each step from the state.
"""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.compiled import compiled, handle, mj_step, records
from cls_bench.parameters import Parameters
from cls_bench.plant import mjcf
from cls_bench.plant.column import STRIBECK
from cls_bench.verification.reduced_model import Guide

Array = NDArray[np.float64]

_LUGRE_DAMPING = 6
"""Place of σ1 in a LuGre actuator's ``dynprm``; σ0 is before it."""

_COULOMB, _STATIC = 3, 4
"""Places in its ``biasprm``."""

_FADE_FROM = 1e-9
"""Friction level [N·m] below which MuJoCo's element would divide by zero."""


class _Memory(NamedTuple):
    """Views of MuJoCo's memory."""

    model: Any
    data: Any
    qpos: Array
    qvel: Array
    applied: Array
    act: Array
    damping: Array  # of the tendons
    spring: Array  # ends of their dead zones
    first: NDArray[np.int32]  # place of a tendon's first joint in ``lever``
    lever: Array
    biasprm: Array
    dynprm: Array


_PLACES = ("tendon", "actuator", "bristle", "before", "behind")

_NUMBERS = (
    "ratio", "teeth", "carried", "stiffness", "backlash", "damping", "error", "ripple", "drag", "drag_back", "loss",
    "loss_back",
)  # fmt: skip

_STAGE = np.dtype([(name, np.int64) for name in _PLACES] + [(name, np.float64) for name in _NUMBERS])
"""A gear stage: places of its parts, and its numbers."""


class _Places(NamedTuple):
    motor: int
    column: int
    stops: int
    bearing: int
    bearing_bristle: int


class _Laws(NamedTuple):
    """Numbers of what is set in every step."""

    breakaway: float
    mesh_damping: float
    mesh_stribeck: float
    stop: float
    stop_stiffness: float
    stop_damping: float
    coulomb: float
    bearing_damping: float
    bearing_stribeck: float


@compiled
def _play(m: _Memory, tendon: int, length: float, rate: float, middle: float, half: float, stiffness: float,
          damping: float) -> float:  # fmt: skip
    """Dead zone of a tendon about ``middle``, and a damper that its spring bounds; returns its torque."""
    beyond = length - middle
    beyond = beyond - half if beyond > half else beyond + half if beyond < -half else 0.0
    spring = stiffness * beyond
    bounded = damping
    if abs(spring) < damping * abs(rate):
        bounded = abs(spring) / abs(rate)
    m.spring[tendon, 0], m.spring[tendon, 1] = middle - half, middle + half
    m.damping[tendon] = bounded
    return spring + bounded * rate


@compiled
def _rub(m: _Memory, actuator: int, bristle: int, velocity: float, level: float, breakaway: float, damping: float,
         stribeck: float) -> None:  # fmt: skip
    level = max(level, _FADE_FROM)
    m.biasprm[actuator, _COULOMB], m.biasprm[actuator, _STATIC] = level, level * breakaway
    bend = level * breakaway / m.dynprm[actuator, _LUGRE_DAMPING - 1]
    m.act[bristle] = min(max(m.act[bristle], -bend), bend)
    faded = damping * math.exp(-((velocity / stribeck) ** 2))
    m.dynprm[actuator, _LUGRE_DAMPING] = min(faded, level / max(abs(velocity), 1e-30))


@compiled
def _set_stage(m: _Memory, e: Any, laws: _Laws) -> None:
    q_before, q_behind, v_before, v_behind = m.qpos[e.before], m.qpos[e.behind], m.qvel[e.before], m.qvel[e.behind]
    phase = e.teeth * (q_before - e.carried * q_behind)
    slope = e.error * e.teeth * math.cos(phase)
    lever, counter = 1.0 / e.ratio - slope, e.carried * slope - 1.0
    first = m.first[e.tendon]
    # A tendon's coefficients are its levers. Its length then says nothing; the dead zone lies relative to it.
    m.lever[first], m.lever[first + 1] = lever, counter
    length = lever * q_before + counter * q_behind
    twist = q_before / e.ratio - q_behind - e.error * math.sin(phase)
    torque = _play(
        m, e.tendon, length, lever * v_before + counter * v_behind, length - twist, 0.5 * e.backlash, e.stiffness,
        e.damping,
    )  # fmt: skip
    back = m.act[e.bristle] * torque < 0.0
    loss, drag, change = e.loss_back if back else e.loss, e.drag, e.drag_back - e.drag
    if change != 0.0:  # from the one to the other on a straight line, to either side as long as they differ
        way = (-abs(torque) if back else abs(torque)) / e.ratio
        drag += change * min(max(0.5 * (1.0 - way / abs(change)), 0.0), 1.0)
    level = (drag + loss * abs(torque) / e.ratio) * (1.0 + e.ripple * math.sin(phase))
    _rub(m, e.actuator, e.bristle, v_before, level, laws.breakaway, laws.mesh_damping, laws.mesh_stribeck)


@compiled
def _run(
    m: _Memory, places: _Places, stages: Any, laws: _Laws, hand: Any, guide: Guide, column: Any, motor: Any
) -> None:
    for k in range(hand.shape[0]):
        motor[k] = guide.stiffness * (guide.angle[k] - m.qpos[places.motor])
        motor[k] += guide.damping * (guide.rate[k] - m.qvel[places.motor])
        m.applied[places.motor], m.applied[places.column] = motor[k], hand[k]
        for number in range(stages.shape[0]):
            _set_stage(m, stages[number], laws)
        angle, velocity = m.qpos[places.column], m.qvel[places.column]
        _play(m, places.stops, angle, velocity, 0.0, laws.stop, laws.stop_stiffness, laws.stop_damping)
        _rub(
            m, places.bearing, places.bearing_bristle, velocity, laws.coulomb, 1.0, laws.bearing_damping,
            laws.bearing_stribeck,
        )  # fmt: skip
        column[k] = angle
        mj_step(m.model, m.data)


class Twin:
    """The whole rig in MuJoCo's own elements, motor open and hand off."""

    def __init__(self, p: Parameters):
        self.model: Any = mjcf.build_spec(p, scene=False).compile()
        self.data: Any = mujoco.MjData(self.model)
        model, data = self.model, self.data
        self.step: float = model.opt.timestep
        motor = model.actuator("motor").id
        model.actuator_gainprm[motor, 1] = 0.0  # open terminals
        model.actuator_biasprm[model.actuator("arm").id, 1:3] = 0.0
        grip = model.tendon("grip").id
        model.tendon_stiffness[grip] = model.tendon_damping[grip] = 0.0
        self._memory = _Memory(
            handle(model), handle(data), data.qpos, data.qvel, data.qfrc_applied, data.act, model.tendon_damping,
            model.tendon_lengthspring, model.tendon_adr, model.wrap_prm, model.actuator_biasprm,
            model.actuator_dynprm,
        )  # fmt: skip

        def bristle(name: str) -> int:
            actuator = model.actuator(name)
            return int(actuator.actadr[0] + actuator.actnum[0] - 1)

        def joint(name: str) -> int:
            return int(model.joint(name).qposadr[0])

        self._places = _Places(
            joint("motor"), joint("column"), model.tendon("stop_blocks").id, model.actuator("column_bearing").id,
            bristle("column_bearing"),
        )  # fmt: skip
        shafts = ["motor", *(f"carrier{k}" for k in range(1, p.gearbox.stages)), "crank"]
        dampings = _mesh_dampings(p)
        stages = [
            (
                model.tendon(f"stage{k}").id, model.actuator(f"stage{k}_friction").id, bristle(f"stage{k}_friction"),
                joint(shafts[k - 1]), joint(shafts[k]), stage.ratio, stage.teeth, stage.kind == "planetary",
                stage.stiffness, stage.backlash, dampings[k - 1], stage.transmission_error if stage.teeth else 0.0,
                stage.ripple, stage.drag, stage.drag * stage.drag_ratio, 1.0 / stage.efficiency - 1.0,
                1.0 - stage.backdrive_efficiency,
            )
            for k, stage in enumerate(p.gearbox.in_use, 1)
        ]  # fmt: skip
        self._stages = records(np.array(stages, dtype=_STAGE))
        box, c = p.gearbox, p.column
        bearing = model.actuator_dynprm[self._places.bearing, _LUGRE_DAMPING]
        self._laws = _Laws(
            box.breakaway_ratio, box.bristle_damping, box.stribeck_velocity, c.stop_angle, c.stop_stiffness,
            c.stop_damping, c.coulomb_friction, float(bearing), STRIBECK,
        )  # fmt: skip

    def run(self, hand: Array, guide: Guide) -> tuple[Array, Array]:
        """Column angle [rad] before each step, from rest, and the torque [N·m] with which ``guide`` pulls the motor.

        ``hand`` is the torque [N·m] on the column.
        """
        column, motor = np.empty(len(hand)), np.empty(len(hand))
        _run(self._memory, self._places, self._stages, self._laws, hand, guide, column, motor)
        return column, motor


def _mesh_dampings(p: Parameters) -> list[float]:
    """Damping [N·m·s/rad] of each mesh for the two inertias that the model's file gives its shafts."""
    shafts = [p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in p.gearbox.in_use)]
    shafts[-1] += p.linkage.crank_inertia
    dampings = []
    for k, stage in enumerate(p.gearbox.in_use):
        lighter = 1.0 / (1.0 / (shafts[k] * stage.ratio**2) + 1.0 / shafts[k + 1])
        dampings.append(stage.damping_ratio * 2.0 * math.sqrt(stage.stiffness * lighter))
    return dampings
