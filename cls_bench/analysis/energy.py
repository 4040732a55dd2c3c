"""Energy audit of a run: work in = change of stored energy + losses, element by element, from recorded signals alone.

The boundary is the motor's air gap on one side and the grip on the other::

    work of motor + work of hand = Δ kinetic + Δ potential + Δ elastic + losses

All angles follow from recorded ones: the load cell's force gives its stretch, column and stretch give the crank by the
closed form of the linkage, the twists give carrier and motor. Speeds are differences over a tick, powers use central
differences: forces act from half a tick before their time to half a tick after. So a residual is an error of the
plant, of the recording or of this audit; nothing is fitted.

The motor's torque is recorded at 5 kHz and interpolated in between; the bearing's friction, which is not recorded, is
computed from the column's speed by its own law (LuGre).
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from cls_bench.compiled import compiled
from cls_bench.errors import InputError
from cls_bench.parameters import GRAVITY, GearStage, Parameters
from cls_bench.signals import TICK_S, TOPIC, VELOCITY_TICKS, Block

Array = NDArray[np.float64]

TOPICS = ("/column", "/gearbox", "/load_cell", "/drive")
"""Topics that are audited, each with all its signals and samples."""

LOSSES = ("stage 1 friction", "stage 2 friction", "stage 1 mesh", "stage 2 mesh", "load cell", "column bearing",
          "stop blocks")  # fmt: skip
"""Where energy is lost: sliding friction and damping of the meshes, damping of load cell and stops, the bearing."""


@dataclass
class EnergyAudit:
    """Energies of a run [J]."""

    duration: float = 0.0
    """time that was audited [s]"""
    work: dict[str, float] = field(default_factory=lambda: {"motor": 0.0, "hand": 0.0})
    """work done on the mechanism"""
    stored: dict[str, float] = field(default_factory=lambda: {"kinetic": 0.0, "potential": 0.0, "elastic": 0.0})
    """change of stored energy from start to end"""
    losses: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LOSSES, 0.0))
    """energy lost in each element of :data:`LOSSES`"""
    returned: dict[str, float] = field(default_factory=lambda: dict.fromkeys(LOSSES, 0.0))
    """most that an element ever gave back of what it had taken: 0 for a true loss"""
    throughput: float = 0.0
    """∫ |motor power| + |hand power|"""
    copper_loss: float = 0.0
    """heat in the winding, outside the boundary"""

    @property
    def residual(self) -> float:
        """Work in less stored energy and losses [J]: 0 if the books balance."""
        return sum(self.work.values()) - sum(self.stored.values()) - sum(self.losses.values())

    @property
    def relative_residual(self) -> float:
        """Residual as a part of the throughput; 0 where nothing moved."""
        return self.residual / self.throughput if self.throughput > 0.0 else 0.0

    def watts(self) -> dict[str, float]:
        """Mean power [W] in and out, by name: where the watts go."""
        entries = {
            **{f"work of the {name}": value for name, value in self.work.items()},
            **{f"lost in {name}": value for name, value in self.losses.items()},
            **{f"stored: {name}": value for name, value in self.stored.items()},
            "copper loss (outside)": self.copper_loss,
        }
        return {name: value / self.duration for name, value in entries.items()} if self.duration > 0.0 else entries


@compiled
def _bearing_friction(
    speed: Any, z: float, stiffness: float, damping: float, level: float, stribeck: float, step: float, out: Any
) -> float:
    """Write the friction torque of the column's bearing at each tick to ``out``; returns the last deflection."""
    limit = level / stiffness
    for k in range(speed.shape[0]):
        v = speed[k]
        z = min(max(z, -limit), limit)
        decay = stiffness * abs(v) / level
        rate = v - decay * z
        fade = damping * math.exp(-((v / stribeck) ** 2))
        if fade * abs(v) > level:
            fade = level / abs(v)
        out[k] = stiffness * z + fade * rate
        grown = -math.expm1(-decay * step) / decay if decay * step > 1e-9 else step
        z += grown * rate
    return z


@dataclass
class _State:
    """Positions of one tick [rad, m] and what else has to be carried from block to block."""

    angles: Array  # θ, α, ψ, φ and stretch
    before: Array  # the same one tick earlier
    far: Array  # position of the rod's far mass (2,)
    far_before: Array


class _Auditor:
    """Adds up a run block by block; a block of n ticks closes the books on n − 1 of them and keeps two."""

    BEARING_STRIBECK = 0.01  # rad/s, as in the plant: where the bearing's presliding damping has faded out

    def __init__(self, p: Parameters):
        self.p = p
        self.audit = EnergyAudit()
        self.carried: dict[str, Array] = {}
        self.filter = np.zeros(1)
        self.bristle = 0.0
        self.lost = dict.fromkeys(LOSSES, 0.0)
        self.peak = dict.fromkeys(LOSSES, 0.0)
        self.first: dict[str, float] | None = None
        self.last: dict[str, float] = {}
        link, column, box = p.linkage, p.column, p.gearbox
        carried = link.rod_end_mass + column.inertia / link.arm**2
        self.cell_damping = 2.0 * p.load_cell.damping_ratio * math.sqrt(p.load_cell.stiffness * carried)
        self.column_inertia = column.inertia + link.rod_end_mass * link.arm**2
        self.crank_inertia = link.crank_inertia + box.carrier2_inertia + link.rod_crank_mass * link.crank**2
        self.far_mass = link.rod_column_mass - link.rod_end_mass

    def add(self, block: Block) -> None:
        """Take in the next block."""
        rows = {path: block.signals[path] for path in TOPICS}
        new = self._signals(block, rows)
        joined = {name: np.concatenate((self.carried[name], new[name])) if self.carried else new[name] for name in new}
        if len(joined["phi"]) >= 4:
            self._close(joined)
        self.carried = {name: values[-3:] for name, values in joined.items()}

    def _signals(self, block: Block, rows: dict[str, Array]) -> dict[str, Array]:
        """Every quantity of the block at every tick."""

        def column_of(path: str, name: str) -> Array:
            return rows[path][:, TOPIC[path].names.index(name)]

        p, link = self.p, self.p.linkage
        force = column_of("/load_cell", "force")
        # Force = c s + k (s − s before)/h, solved for the stretch s.
        dash = self.cell_damping / TICK_S
        total = p.load_cell.stiffness + dash
        stretch, self.filter = lfilter([1.0 / total], [1.0, -dash / total], force, zi=self.filter)
        phi = column_of("/column", "angle")
        psi, far = _crank(link.crank, link.rod, link.arm, phi, stretch)
        alpha = p.gearbox.ratio * (psi + column_of("/gearbox", "stage2_twist"))
        theta = p.gearbox.ratio * (alpha + column_of("/gearbox", "stage1_twist"))
        ticks = np.arange(block.first_tick, block.end_tick)
        drive = block.row_ticks(VELOCITY_TICKS)
        bearing = np.empty(len(phi))
        self.bristle = _bearing_friction(
            column_of("/column", "velocity"), self.bristle, p.column.bristle_stiffness,
            0.2 * math.sqrt(p.column.bristle_stiffness * self.column_inertia), max(p.column.coulomb_friction, 1e-9),
            self.BEARING_STRIBECK, TICK_S, bearing,
        )  # fmt: skip
        return {
            "theta": theta, "alpha": alpha, "psi": psi, "phi": phi, "stretch": stretch, "far_x": far[0],
            "far_z": far[1], "force": force, "bearing": bearing, "hand": column_of("/column", "torque"),
            "motor": np.interp(ticks, drive, column_of("/drive", "torque")),
            "current": np.interp(ticks, drive, column_of("/drive", "current")),
            "torque1": column_of("/gearbox", "stage1_torque"), "torque2": column_of("/gearbox", "stage2_torque"),
            "friction1": column_of("/gearbox", "stage1_friction"),
            "friction2": column_of("/gearbox", "stage2_friction"),
        }  # fmt: skip

    def _close(self, s: dict[str, Array]) -> None:
        """Close the books on all ticks but the first and last two of ``s``."""
        p = self.p

        def rate(name: str) -> Array:
            return (s[name][2:-1] - s[name][:-3]) / (2.0 * TICK_S)  # central, at ticks 1 … n − 3

        def now(name: str) -> Array:
            return s[name][1:-2]

        theta, alpha, phi, stretch = (rate(name) for name in ("theta", "alpha", "phi", "stretch"))
        motor, hand = now("motor") * theta, now("hand") * phi
        audit = self.audit
        audit.duration += len(phi) * TICK_S
        audit.work["motor"] += float(np.sum(motor)) * TICK_S
        audit.work["hand"] += float(np.sum(hand)) * TICK_S
        audit.throughput += float(np.sum(np.abs(motor) + np.abs(hand))) * TICK_S
        audit.copper_loss += p.motor.resistance * float(np.sum(now("current") ** 2)) * TICK_S

        lost1, elastic1 = self._mesh(p.gearbox.stage1, s["theta"], s["alpha"], s["torque1"])
        lost2, elastic2 = self._mesh(p.gearbox.stage2, s["alpha"], s["psi"], s["torque2"])
        stop, elastic_stop = self._stop(s["phi"])
        lost = {
            "stage 1 friction": now("friction1") * theta,
            "stage 2 friction": now("friction2") * alpha,
            "stage 1 mesh": lost1,
            "stage 2 mesh": lost2,
            "load cell": (now("force") - p.load_cell.stiffness * now("stretch")) * stretch,
            "column bearing": (now("bearing") + p.column.viscous_friction * phi) * phi,
            "stop blocks": stop[1:-2] * phi,
        }
        elastic = elastic1 + elastic2 + elastic_stop + 0.5 * p.load_cell.stiffness * s["stretch"] ** 2
        for name, signal, bristle_stiffness in (
            ("stage 1 friction", "friction1", p.gearbox.bristle_stiffness),
            ("stage 2 friction", "friction2", p.gearbox.bristle_stiffness),
            ("column bearing", "bearing", p.column.bristle_stiffness),
        ):
            held = 0.5 * s[signal] ** 2 / bristle_stiffness  # what the bristles hold is not lost yet
            elastic = elastic + held
            lost[name] = lost[name] - (held[2:-1] - held[:-3]) / (2.0 * TICK_S)
        for name, power in lost.items():
            total = self.lost[name] + np.cumsum(power) * TICK_S
            peak = np.maximum(np.maximum.accumulate(total), self.peak[name])
            audit.returned[name] = max(audit.returned[name], float(np.max(peak - total)))
            self.lost[name], self.peak[name] = float(total[-1]), float(peak[-1])
            audit.losses[name] = self.lost[name]
        self._store(s, elastic)

    def _mesh(self, stage: GearStage, before: Array, behind: Array, torque: Array) -> tuple[Array, Array]:
        """Power lost in the damping of a mesh [W] at the closed ticks, and its elastic energy [J]."""
        twist = before / self.p.gearbox.ratio - behind
        twist = twist - stage.transmission_error * np.sin(stage.sun_teeth * (before - behind))
        beyond = np.sign(twist) * np.maximum(np.abs(twist) - 0.5 * stage.backlash, 0.0)
        damper = torque - stage.stiffness * beyond
        return damper[1:-2] * (twist[2:-1] - twist[:-3]) / (2.0 * TICK_S), 0.5 * stage.stiffness * beyond**2

    def _stop(self, phi: Array) -> tuple[Array, Array]:
        """Damping torque [N·m] and elastic energy [J] of the stop blocks."""
        column = self.p.column
        beyond = np.sign(phi) * np.maximum(np.abs(phi) - column.stop_angle, 0.0)
        rate = np.gradient(phi, TICK_S)
        damper = np.where(beyond != 0.0, column.stop_damping * rate, 0.0)
        spring = column.stop_stiffness * np.abs(beyond)
        return np.clip(damper, -spring, spring), 0.5 * column.stop_stiffness * beyond**2

    def _store(self, s: dict[str, Array], elastic: Array) -> None:
        """Energy stored half a tick before the first closed tick, and half a tick after the last."""
        p, link = self.p, self.p.linkage
        box = p.gearbox
        inertias = {
            "theta": p.motor.rotor_inertia + box.input_inertia, "alpha": box.carrier1_inertia,
            "psi": self.crank_inertia, "phi": self.column_inertia, "far_x": self.far_mass, "far_z": self.far_mass,
        }  # fmt: skip
        height = (
            link.rod_crank_mass * link.crank * np.cos(s["psi"]) + self.far_mass * s["far_z"]
            + (p.column.mass * p.column.mass_height + link.rod_end_mass * link.arm) * np.cos(s["phi"])
        )  # fmt: skip

        def between(k: int) -> dict[str, float]:
            """Stored energy between ticks ``k`` and ``k + 1`` of ``s``."""
            kinetic = sum(0.5 * j * ((s[n][k + 1] - s[n][k]) / TICK_S) ** 2 for n, j in inertias.items())
            return {
                "kinetic": float(kinetic),
                "potential": GRAVITY * 0.5 * float(height[k] + height[k + 1]),
                "elastic": 0.5 * float(elastic[k] + elastic[k + 1]),
            }

        if self.first is None:
            self.first = between(0)
        self.last = between(len(s["phi"]) - 3)
        self.audit.stored = {name: value - self.first[name] for name, value in self.last.items()}


def _crank(crank: float, rod: float, arm: float, phi: Array, stretch: Array) -> tuple[Array, tuple[Array, Array]]:
    """Crank angle [rad] and the place [m] of the rod's far mass, from column angle and stretch of the load cell.

    The crank joint lies where a circle of the rod's length, stretch included, about the column joint meets the
    crank's own circle; of the two places the upper one.
    """
    x, z = arm * np.sin(phi) + rod, arm * np.cos(phi) - (arm - crank)  # column joint from the crank's axis
    distance = np.hypot(x, z)
    cosine = (distance**2 + crank**2 - (rod + stretch) ** 2) / (2.0 * crank * distance)
    psi = np.arctan2(x, z) - np.arccos(np.clip(cosine, -1.0, 1.0))
    joint_x, joint_z = crank * np.sin(psi), crank * np.cos(psi)
    share = rod / (rod + stretch)
    return psi, (joint_x + share * (x - joint_x), joint_z + share * (z - joint_z))


def audit(blocks: Iterable[Block], parameters: Parameters) -> EnergyAudit:
    """Audit a run from its ``blocks``: those of a bench, or those of a recording::

        recording = Recording(path)
        books = audit(recording.blocks(), Parameters(**recording.parameters))
        books.watts()

    Parameters of the plant hold for a whole run, so ``parameters`` are those of its start. The audit is made for one
    plant step a tick; with ``simulation.substeps`` above 1 it balances a little less well. Raises
    :class:`InputError` if the blocks are fewer than four ticks long in all.
    """
    auditor = _Auditor(parameters)
    for block in blocks:
        auditor.add(block)
    if auditor.first is None:
        raise InputError("the run is too short to be audited: it has fewer than four ticks")
    return auditor.audit
