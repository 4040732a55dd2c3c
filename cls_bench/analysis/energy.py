"""Energy audit of a run: work in = change of stored energy + losses, element by element, from recorded signals alone.

The boundary is the motor's air gap on one side and the grip on the other::

    work of motor + work of hand = Δ kinetic + Δ potential + Δ elastic + losses

and what lies beyond has books of its own, the winding and the pilot's limb::

    electrical input = copper loss + Δ energy of the inductance + work of motor
    work of arm      = Δ kinetic of the forearm + lost in the grip + Δ elastic of the grip + work of hand − squeezing

All angles follow from recorded ones: the load cell's force gives its stretch, column and stretch give the crank by the
closed form of the linkage, the twists of the stages give every shaft up to the motor's. Speeds are differences over a
tick, powers use central differences: forces act from half a tick before their time to half a tick after. So a residual
is an error of the plant, of the recording or of this audit; nothing is fitted.

Signals of drive and pilot are recorded once a velocity cycle and interpolated in between: with a row for each tick the
books balance to 1e-4 of the throughput and the winding's to 2e-4 of its heat and work, at the thesis's rates to 1e-3
and 3 %. Violent chatter, whose contacts last a few ticks, and teeth that pass faster than the ticks leave more: up to
7 % on random rigs. The bearing's friction, which is not recorded, is computed from the column's speed by its own law
(LuGre). The arm's intended motion is not recorded: its work is what the limb's book leaves, and its own damping is not
told apart; the limb is taken to be as at the start.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cls_bench.analysis.window import on_axis
from cls_bench.compiled import compiled
from cls_bench.errors import InputError
from cls_bench.kinematics import FourBar, crank_axis
from cls_bench.parameters import GRAVITY, GearStage, Parameters
from cls_bench.signals import Block, Clock

Array = NDArray[np.float64]

TOPICS = ("/column", "/gearbox", "/load_cell", "/drive")
"""Topics that are audited, each with all its signals and samples; without a gear stage there is no ``/gearbox``."""


def loss_names(stages: int) -> tuple[str, ...]:
    """Where energy is lost on a rig of so many stages: friction and damping of each mesh, and of all else."""
    meshes = (f"stage {k} {what}" for k in range(1, stages + 1) for what in ("friction", "mesh"))
    return (*meshes, "load cell", "column bearing", "stop blocks")


@dataclass
class EnergyAudit:
    """Energies of a run [J]."""

    losses: dict[str, float]
    """energy lost in each element of :func:`loss_names`"""
    returned: dict[str, float]
    """most that an element ever gave back of what it had taken: 0 for a true loss"""
    duration: float = 0.0
    """time that was audited [s]"""
    work: dict[str, float] = field(default_factory=lambda: {"motor": 0.0, "hand": 0.0})
    """work done on the mechanism"""
    stored: dict[str, float] = field(default_factory=lambda: {"kinetic": 0.0, "potential": 0.0, "elastic": 0.0})
    """change of stored energy from start to end; a cogging motor's magnets count as potential"""
    throughput: float = 0.0
    """∫ |motor power| + |hand power|"""
    copper_loss: float = 0.0
    """heat in the winding, outside the boundary"""
    inductance: float = 0.0
    """change of the energy in the winding's inductance, outside the boundary"""
    electrical: float = 0.0
    """input at the motor's terminals, from the recorded voltage and current"""
    limb: dict[str, float] = field(default_factory=dict)
    """outside the boundary: work of the ``arm`` on the forearm, change of the ``forearm``'s kinetic energy, ``grip
    lost`` and ``grip elastic``, and the work of ``squeezing`` the grip; empty if the hand was not recorded"""

    @classmethod
    def of(cls, stages: int) -> "EnergyAudit":
        """Of a rig of so many stages, with nothing in it yet."""
        names = loss_names(stages)
        return cls(dict.fromkeys(names, 0.0), dict.fromkeys(names, 0.0))

    @property
    def residual(self) -> float:
        """Work in less stored energy and losses [J]: 0 if the books balance."""
        return sum(self.work.values()) - sum(self.stored.values()) - sum(self.losses.values())

    @property
    def relative_residual(self) -> float:
        """Residual as a part of the throughput; 0 where nothing moved."""
        return self.residual / self.throughput if self.throughput > 0.0 else 0.0

    @property
    def electrical_residual(self) -> float:
        """Electrical input less copper loss, energy of the inductance and work of the motor [J]."""
        return self.electrical - self.copper_loss - self.inductance - self.work["motor"]

    def watts(self) -> dict[str, float]:
        """Mean power [W] in and out, by name: where the watts go."""
        entries = {
            **{f"work of the {name}": value for name, value in self.work.items()},
            **{f"lost in {name}": value for name, value in self.losses.items()},
            **{f"stored: {name}": value for name, value in self.stored.items()},
            "copper loss (outside)": self.copper_loss,
            "inductance (outside)": self.inductance,
        }
        return {name: value / self.duration for name, value in entries.items()} if self.duration > 0.0 else entries


@compiled
def _bearing_friction(
    speed: Any, z: float, stiffness: float, damping: float, level: float, stribeck: float, step: float, out: Any
) -> float:
    """Write the friction torque of the column's bearing at each tick to ``out``; returns the last deflection.

    The speed is that of the step that led to the tick: it has bent the bristle already.
    """
    limit = level / stiffness
    for k in range(speed.shape[0]):
        v = speed[k]
        decay = stiffness * abs(v) / level
        z = min(max(z, -limit), limit)
        grown = -math.expm1(-decay * step) / decay if decay * step > 1e-9 else step
        z += grown * (v - decay * z)
        fade = damping * math.exp(-((v / stribeck) ** 2))
        if fade * abs(v) > level:
            fade = level / abs(v)
        out[k] = stiffness * z + fade * (v - decay * z)
    return z


_BEARING_STRIBECK = 0.01
"""As in the plant [rad/s]: where the bearing's presliding damping has faded out."""


_OF_MOTOR = ("torque", "current", "voltage")
_OF_PILOT = ("limb_angle", "squeeze")
"""Signals that have rows of their own, once a velocity cycle."""


class _Linkage:
    """Where crank and far mass of the rod are, from column angle and stretch of the load cell."""

    def __init__(self, bar: FourBar):
        self.bar = bar
        self.axis = crank_axis(bar)
        # Of the two assemblies the one at neutral: on which side of the line to the column pin the crank stands.
        x, z = self._pin(np.zeros(1))
        self.side = 1.0 if math.sin(bar.crank_angle - math.atan2(x[0], z[0])) > 0.0 else -1.0

    def _pin(self, phi: Array) -> tuple[Array, Array]:
        """Column pin from the crank's axis (x, z) [m]."""
        at = phi + self.bar.arm_angle
        return self.bar.arm * np.sin(at) - self.axis[0], self.bar.arm * np.cos(at) - self.axis[1]

    def crank(self, phi: Array, stretch: Array) -> tuple[Array, Array, Array]:
        """Crank angle [rad], and the far mass from the crank's axis (x, z) [m].

        The crank pin lies where a circle of the rod's length, stretch included, about the column pin meets the crank's
        own circle. The far mass is as far from the crank pin as the unloaded rod is long.
        """
        bar = self.bar
        if bar.rod == 0.0:  # a shaft
            return phi - stretch / bar.arm, np.zeros_like(phi), np.zeros_like(phi)
        x, z = self._pin(phi)
        distance = np.hypot(x, z)
        cosine = (distance**2 + bar.crank**2 - (bar.rod + stretch) ** 2) / (2.0 * bar.crank * distance)
        at = np.arctan2(x, z) + self.side * np.arccos(np.clip(cosine, -1.0, 1.0))
        psi = at - bar.crank_angle
        psi = psi - 2.0 * math.pi * np.floor(psi / (2.0 * math.pi) + 0.5)
        joint_x, joint_z = bar.crank * np.sin(at), bar.crank * np.cos(at)
        share = bar.rod / (bar.rod + stretch)
        return psi, joint_x + share * (x - joint_x), joint_z + share * (z - joint_z)


class _Auditor:
    """Adds up a run block by block.

    A tick is audited once its neighbours are there and a row of the drive beyond it, so some are kept for later.
    """

    def __init__(self, p: Parameters, clock: Clock, axis: str):
        self.p, self.clock, self.axis = p, clock, axis
        self.stages = p.gearbox.in_use
        self.audit = EnergyAudit.of(len(self.stages))
        self.linkage = _Linkage(p.linkage.four_bar)
        self.ticks: dict[str, Array] = {}  # signals of the ticks that are still open, by name
        self.rows: dict[str, Array] = {}  # and of the drive, at the ticks "tick"
        self.first_tick = 0  # of those that are open
        self.filter: Array | None = None
        self.bristle = 0.0
        self.peak = dict.fromkeys(self.audit.losses, 0.0)
        self.grip = {"taken": 0.0, "lost": 0.0}
        self.first: dict[str, float] | None = None
        arm = p.linkage.arm
        at_crank, self.far_mass, end = p.linkage.masses
        carried = end + p.column.inertia / arm**2
        self.cell_damping = 2.0 * p.load_cell.damping_ratio * math.sqrt(p.load_cell.stiffness * carried)
        self.column_inertia = p.column.inertia + end * arm**2
        self.inertias = [p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in self.stages)]
        """of each shaft, from the motor's to the crank's [kg·m²]"""
        self.inertias[-1] += p.linkage.crank_inertia + at_crank * p.linkage.four_bar.crank**2

    def add(self, block: Block) -> None:
        """Take in the next block."""
        if not self.ticks:
            self.first_tick = block.first_tick
        elif block.first_tick != self.first_tick + len(self.ticks["column"]):
            at = self.clock.time(block.first_tick)
            raise InputError(f"the run cannot be audited: before {at:.4f} s ticks are lost")
        self.ticks = _joined(self.ticks, self._signals(block))
        self.rows = _joined(self.rows, self._rows(block))
        if len(self.rows["tick"]):
            self._close(int(self.rows["tick"][-1]) - self.first_tick + 1)

    def finish(self) -> EnergyAudit:
        """Close the books on what is left. Raises InputError if the run was too short."""
        self._close(len(self.ticks["column"]) if self.ticks else 0)
        if self.first is None:
            raise InputError("the run is too short to be audited: it has fewer than four ticks")
        if not all(math.isfinite(value) for value in self.audit.limb.values()):
            self.audit.limb = {}
        return self.audit

    def _column(self, block: Block, signal: str) -> Array:
        try:
            return block[on_axis(signal, self.axis)]
        except (KeyError, ValueError):
            raise InputError(f"the run cannot be audited: it has no {on_axis(signal, self.axis)}") from None

    def _rows(self, block: Block) -> dict[str, Array]:
        """What is known of the drive's rows of the block; NaN of a hand that was not recorded with them."""
        ticks = block.row_ticks(block.topic(on_axis("/drive", self.axis)).ticks).astype(np.float64)
        rows = {"tick": ticks, **{f"motor_{name}": self._column(block, f"/drive.{name}") for name in _OF_MOTOR}}
        for name in _OF_PILOT:
            try:
                values = self._column(block, f"/pilot.{name}")
            except InputError:
                values = np.zeros(0)
            rows[name] = values if len(values) == len(ticks) else np.full(len(ticks), np.nan)
        return rows

    def _signals(self, block: Block) -> dict[str, Array]:
        """What is known of every tick of the block but what has rows of its own."""
        p, step = self.p, self.clock.tick_s
        phi, speed = self._column(block, "/column.angle"), self._column(block, "/column.velocity")
        force = self._column(block, "/load_cell.force")
        # Force = c s + d (s − s before)/h, solved for the stretch s.
        dash = self.cell_damping / step
        total = p.load_cell.stiffness + dash
        if self.filter is None:
            self.filter = force[:1] / p.load_cell.stiffness * dash / total
        stretch, self.filter = lfilter([1.0 / total], [1.0, -dash / total], force, zi=self.filter)
        psi, far_x, far_z = self.linkage.crank(phi, stretch)
        bearing, bristle_stiffness = np.empty(len(phi)), p.column.bristle_stiffness
        self.bristle = _bearing_friction(
            speed, self.bristle, bristle_stiffness, 0.2 * math.sqrt(bristle_stiffness * self.column_inertia),
            max(p.column.coulomb_friction, 1e-9), _BEARING_STRIBECK, step, bearing,
        )  # fmt: skip
        found = {
            "column": phi, "speed": speed, "hand": self._column(block, "/column.torque"), "bearing": bearing,
            "force": force, "stretch": stretch, "far_x": far_x, "far_z": far_z, f"shaft{len(self.stages)}": psi,
        }  # fmt: skip
        for k in reversed(range(len(self.stages))):
            twist = self._column(block, f"/gearbox.stage{k + 1}_twist")
            found[f"shaft{k}"] = self.stages[k].ratio * (found[f"shaft{k + 1}"] + twist)
            found[f"torque{k}"] = self._column(block, f"/gearbox.stage{k + 1}_torque")
            found[f"friction{k}"] = self._column(block, f"/gearbox.stage{k + 1}_friction")
        return found

    def _close(self, count: int) -> None:
        """Close the books on the first ``count`` open ticks; the last three of them stay open."""
        if count < 4:
            return
        ticks = np.arange(self.first_tick, self.first_tick + count)
        s = {name: values[:count] for name, values in self.ticks.items()}
        at = self.rows["tick"]
        for name in (*(f"motor_{name}" for name in _OF_MOTOR), "limb_angle"):
            s[name] = np.interp(ticks, at, self.rows[name])
        if len(at) > 1:  # beyond the last row the forearm goes on as it went
            speed = (self.rows["limb_angle"][-1] - self.rows["limb_angle"][-2]) / (at[-1] - at[-2])
            s["limb_angle"] += speed * np.maximum(ticks - at[-1], 0.0)
        last = np.searchsorted(at, ticks, side="right") - 1
        s["squeeze"] = self.rows["squeeze"][np.maximum(last, 0)]
        self._audit(s)
        done = count - 3
        self.ticks = {name: values[done:] for name, values in self.ticks.items()}
        self.first_tick += done
        kept = max(0, min(int(np.searchsorted(at, self.first_tick, side="right")) - 1, len(at) - 2))
        self.rows = {name: values[kept:] for name, values in self.rows.items()}

    def _audit(self, s: dict[str, Array]) -> None:
        """Audit all ticks of ``s`` but the first and the last two."""
        p, step, audit = self.p, self.clock.tick_s, self.audit

        def rate(values: Array) -> Array:
            return (values[2:-1] - values[:-3]) / (2.0 * step)  # central, at ticks 1 … n − 3

        def now(name: str) -> Array:
            return s[name][1:-2]

        column, stretching = rate(s["column"]), rate(s["stretch"])
        motor, hand = now("motor_torque") * rate(s["shaft0"]), now("hand") * column
        audit.duration += len(column) * step
        audit.work["motor"] += float(np.sum(motor)) * step
        audit.work["hand"] += float(np.sum(hand)) * step
        audit.throughput += float(np.sum(np.abs(motor) + np.abs(hand))) * step
        # Voltage and current from tick to tick: the voltage is held, the current runs from one value to the next.
        voltage, before, after = s["motor_voltage"][:-1], s["motor_current"][:-1], s["motor_current"][1:]
        heat = p.motor.resistance * (before**2 + before * after + after**2) / 3.0
        audit.copper_loss += _about_ticks(heat) * step
        audit.electrical += _about_ticks(voltage * 0.5 * (before + after)) * step
        magnetic = 0.5 * p.motor.inductance * s["motor_current"] ** 2
        audit.inductance += 0.5 * float(magnetic[-3] + magnetic[-2] - magnetic[0] - magnetic[1])

        stop, elastic = self._stop(s["column"], s["speed"])
        elastic = elastic + 0.5 * p.load_cell.stiffness * s["stretch"] ** 2
        bearing = self._held(s["bearing"], p.column.bristle_stiffness)
        lost = {
            "load cell": (now("force") - p.load_cell.stiffness * now("stretch")) * stretching,
            "column bearing": (now("bearing") + p.column.viscous_friction * column) * column - rate(bearing),
            "stop blocks": stop[1:-2] * column,
        }
        elastic = elastic + bearing
        for k, stage in enumerate(self.stages):
            input_shaft = s[f"shaft{k}"]
            deflection = _deflection(stage, input_shaft, s[f"shaft{k + 1}"])
            damper = s[f"torque{k}"] - stage.stiffness * deflection
            lost[f"stage {k + 1} mesh"] = damper[1:-2] * rate(deflection)
            held = self._held(s[f"friction{k}"], p.gearbox.bristle_stiffness)
            lost[f"stage {k + 1} friction"] = now(f"friction{k}") * rate(input_shaft) - rate(held)
            elastic = elastic + held + 0.5 * stage.stiffness * deflection**2
        for name, power in lost.items():
            total = audit.losses[name] + np.cumsum(power) * step
            peak = np.maximum(np.maximum.accumulate(total), self.peak[name])
            audit.returned[name] = max(audit.returned[name], float(np.max(peak - total)))
            audit.losses[name], self.peak[name] = float(total[-1]), float(peak[-1])
        self._store(s, elastic, self._grip(s))

    def _grip(self, s: dict[str, Array]) -> Array:
        """Audit what lies between forearm and column; returns the elastic energy of the grip [J]."""
        limb, step, area = self.p.limb, self.clock.tick_s, self.p.column.grip_height**2
        stiffness = area * _of_squeeze(limb.loose_stiffness, limb.tight_stiffness, s["squeeze"])
        damping = area * _of_squeeze(limb.loose_damping, limb.tight_damping, s["squeeze"])
        closing = np.gradient(s["limb_angle"] - s["column"], step)
        self.grip["taken"] += float(np.sum((s["hand"] * closing)[1:-2])) * step
        self.grip["lost"] += float(np.sum((damping * closing**2)[1:-2])) * step
        spring = s["hand"] - damping * closing
        return np.divide(0.5 * spring**2, stiffness, out=np.zeros_like(spring), where=stiffness != 0.0)

    @staticmethod
    def _held(friction: Array, stiffness: float) -> Array:
        """What bent bristles hold [J]: not lost yet."""
        return 0.5 * friction**2 / stiffness

    def _stop(self, phi: Array, speed: Array) -> tuple[Array, Array]:
        """Damping torque [N·m] and elastic energy [J] of the stop blocks."""
        column = self.p.column
        beyond = np.sign(phi) * np.maximum(np.abs(phi) - column.stop_angle, 0.0)
        spring = column.stop_stiffness * np.abs(beyond)
        return np.clip(column.stop_damping * speed, -spring, spring), 0.5 * column.stop_stiffness * beyond**2

    def _store(self, s: dict[str, Array], elastic: Array, grip: Array) -> None:
        """Energy stored half a tick before the first audited tick, and half a tick after the last."""
        p, link, step = self.p, self.p.linkage, self.clock.tick_s
        at_crank, _, end = link.masses
        bar = link.four_bar
        inertias = {
            **{f"shaft{k}": inertia for k, inertia in enumerate(self.inertias)},
            "column": self.column_inertia, "far_x": self.far_mass, "far_z": self.far_mass,
        }  # fmt: skip
        potential = GRAVITY * (
            at_crank * bar.crank * np.cos(s[f"shaft{len(self.stages)}"] + bar.crank_angle) + self.far_mass * s["far_z"]
            + p.column.mass * p.column.mass_height * np.cos(s["column"])
            + end * bar.arm * np.cos(s["column"] + bar.arm_angle)
        )  # fmt: skip
        if p.motor.cogging_amplitude != 0.0:
            periods = p.motor.cogging_periods
            potential = potential + p.motor.cogging_amplitude / periods * np.cos(periods * s["shaft0"])

        forearm = p.limb.mass * p.column.grip_height**2

        def between(k: int) -> dict[str, float]:
            """Stored energy between ticks ``k`` and ``k + 1`` of ``s``."""
            kinetic = sum(0.5 * j * ((s[n][k + 1] - s[n][k]) / step) ** 2 for n, j in inertias.items())
            return {
                "kinetic": float(kinetic),
                "potential": 0.5 * float(potential[k] + potential[k + 1]),
                "elastic": 0.5 * float(elastic[k] + elastic[k + 1]),
                "forearm": 0.5 * forearm * float((s["limb_angle"][k + 1] - s["limb_angle"][k]) / step) ** 2,
                "grip": 0.5 * float(grip[k] + grip[k + 1]),
            }

        if self.first is None:
            self.first = between(0)
        last = between(len(s["column"]) - 3)
        change = {name: value - self.first[name] for name, value in last.items()}
        self.audit.stored = {name: change[name] for name in ("kinetic", "potential", "elastic")}
        taken, lost = self.grip["taken"], self.grip["lost"]
        self.audit.limb = {
            "arm": change["forearm"] + taken + self.audit.work["hand"], "forearm": change["forearm"],
            "grip lost": lost, "grip elastic": change["grip"], "squeezing": lost + change["grip"] - taken,
        }  # fmt: skip


def _joined(before: dict[str, Array], new: dict[str, Array]) -> dict[str, Array]:
    return {name: np.concatenate((before[name], new[name])) for name in new} if before else new


def _of_squeeze(loose: float, tight: float, squeeze: Array) -> Array:
    """Stiffness or damping of the grip: logarithmic from loose to tight, linear from or to nought; 0 of a hand off."""
    both = loose > 0.0 and tight > 0.0
    return np.where(
        squeeze < 0.0, 0.0, loose * (tight / loose) ** squeeze if both else loose + squeeze * (tight - loose)
    )


def _about_ticks(between: Array) -> float:
    """Sum of what lies ``between`` ticks from half a tick before to half a tick after each that is audited."""
    return 0.5 * float(np.sum(between[:-2]) + np.sum(between[1:-1]))


def _deflection(stage: GearStage, before: Array, behind: Array) -> Array:
    """How far the mesh between two shafts is pressed together, at its output [rad]; 0 within the backlash."""
    twist = before / stage.ratio - behind
    twist = twist - stage.transmission_error * np.sin(stage.teeth * (before - stage.carried * behind))
    return np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * stage.backlash, 0.0)


def audit(blocks: Iterable[Block], parameters: Parameters, axis: str = "") -> EnergyAudit:
    """Audit a run from its ``blocks``: those of a bench, or those of a recording::

        recording = Recording(path)
        books = audit(recording.blocks(), Parameters(**recording.parameters))
        books.watts()

    ``parameters`` and ``axis`` name the rig and the axis whose books are wanted; no axis carries energy to another.
    Parameters of the plant hold for a whole run, so they are those of its start. The audit is made for one plant step a
    tick; with ``simulation.substeps`` above 1 it balances a little less well. Raises :class:`InputError` if the blocks
    are fewer than four ticks long in all, or lack a signal.
    """
    auditor: _Auditor | None = None
    for block in blocks:
        auditor = auditor or _Auditor(parameters, block.clock, axis)
        auditor.add(block)
    return (auditor or _Auditor(parameters, parameters.rates.clock, axis)).finish()
