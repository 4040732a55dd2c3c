"""The table of recorded signals, and the blocks in which they travel.

Every topic, signal name, unit, rate, sign and source is defined in :func:`topics` and nowhere else; what the tick
writes, the MCAP schemas, the Rerun entities and the documentation derive from it.

Signs: angles are positive when the grip moves forward, away from the pilot (push); forces and torques are positive
when they act in that direction; the load cell's force is positive in tension, which is what a pushing pilot causes.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SHORTEST_TICK, LONGEST_TICK = 10e-6, 200e-6
"""Of the current controller's cycle, which is the tick [s]."""

LONGEST_CYCLE = 0.01
"""Of any other [s]."""

MOST_TICKS = 64
"""Ticks in the longest cycle."""


class Clock(NamedTuple):
    """How long a tick is, and how many ticks the cycles of drive, field bus and PLC last."""

    tick_ns: int = 50_000
    """length of a tick [ns]: the plant's and the current controller's period"""
    velocity_ticks: int = 4
    position_ticks: int = 8
    bus_ticks: int = 8
    plc_ticks: int = 8

    @property
    def tick_s(self) -> float:
        """Length of a tick [s]."""
        return self.tick_ns * 1e-9

    @property
    def plc_s(self) -> float:
        """Length of a PLC cycle [s]."""
        return self.plc_ticks * self.tick_s

    @property
    def velocity_s(self) -> float:
        """Length of a cycle of the velocity controller [s]."""
        return self.velocity_ticks * self.tick_s

    @property
    def position_s(self) -> float:
        """Length of a cycle of the position controller [s]."""
        return self.position_ticks * self.tick_s

    @property
    def drive_ticks(self) -> int:
        """Ticks between two recorded rows of the drive: its velocity cycle, or the part of it that fits into the PLC's.

        So a row of any topic falls on each tick of the PLC.
        """
        return math.gcd(self.velocity_ticks, self.plc_ticks)

    @property
    def pose_ticks(self) -> int:
        """Ticks between two recorded sets of body poses: whole PLC cycles, about 100 Hz, for the eye only."""
        return self.plc_ticks * max(1, round(10_000_000 / (self.plc_ticks * self.tick_ns)))

    def check(self) -> None:
        """Raise ValueError unless a bench can have these rates: those that ``parameters.rates`` allows."""
        if not SHORTEST_TICK <= self.time(1) <= LONGEST_TICK:
            valid = f"{1e6 * SHORTEST_TICK:g} to {1e6 * LONGEST_TICK:g} µs"
            raise ValueError(f"tick_ns = {self.tick_ns} is not {valid}")
        for name, of in _CYCLES:
            ticks, base = getattr(self, name), getattr(self, of) if of else 1
            if not 1 <= ticks <= MOST_TICKS or not SHORTEST_TICK <= self.time(ticks) <= LONGEST_CYCLE:
                most = min(MOST_TICKS, int(1e9 * LONGEST_CYCLE) // self.tick_ns)
                raise ValueError(f"{name} = {ticks} is not 1 to {most}")
            if ticks % base:
                raise ValueError(f"{name} = {ticks} is no multiple of {of} = {base}")

    def time(self, tick: int) -> float:
        """Time of a tick since the start of the run [s]."""
        return tick * self.tick_ns / 1e9

    def tick_of(self, time: float) -> int:
        """Number of the tick that is nearest to ``time`` [s]."""
        return round(time * 1e9 / self.tick_ns)

    def plc_cycle(self, time: float) -> int:
        """First tick of the PLC cycle in which what is to happen at ``time`` [s] does."""
        return -(-self.tick_of(time) // self.plc_ticks) * self.plc_ticks


_CYCLES = (
    ("velocity_ticks", ""), ("position_ticks", "velocity_ticks"), ("bus_ticks", ""), ("plc_ticks", "bus_ticks")
)  # fmt: skip
"""Each cycle, and what it is a multiple of."""

CLOCK = Clock()
"""The thesis's rates: 20 kHz, 5 kHz, 2.5 kHz."""


@dataclass(frozen=True)
class Signal:
    """One recorded quantity: its name, SI unit (``"1"`` if it has none) and meaning."""

    name: str
    unit: str
    meaning: str
    source: str = field(default="", compare=False)
    """dotted name of the number in an axis's record, :data:`cls_bench.axis.AXIS`; empty in what a file tells"""


@dataclass(frozen=True)
class Topic:
    """Signals sampled together: a row every ``ticks`` ticks, at tick numbers divisible by ``ticks``."""

    path: str
    ticks: int
    meaning: str
    signals: tuple[Signal, ...]
    tick_ns: int = CLOCK.tick_ns
    """length of a tick [ns]"""

    @property
    def axis(self) -> str:
        """Name of the axis that it belongs to: ``pitch`` of ``/pitch/column``, empty if there is but one."""
        return axis_of(self.path)

    @property
    def names(self) -> tuple[str, ...]:
        """The signals' names in column order."""
        return tuple(s.name for s in self.signals)

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1e9 / (self.ticks * self.tick_ns)

    def rows(self, first_tick: int, ticks: int) -> int:
        """Number of rows that fall into ticks ``first_tick … first_tick + ticks − 1``."""
        return -(-(first_tick + ticks) // self.ticks) - -(-first_tick // self.ticks)


MOST_STAGES = 3
"""Stages that a gearbox may have."""

_AXIS = re.compile("[a-z][a-z0-9_]{0,19}")


def _stage(k: int) -> tuple[tuple[str, str, str, str], ...]:
    body = "truth.body"
    return (
        (f"stage{k}_twist", "rad", f"twist of stage {k}, backlash included", f"{body}.twist.{k}"),
        (f"stage{k}_torque", "N·m", f"torque through the mesh of stage {k}", f"{body}.mesh_torque.{k}"),
        (f"stage{k}_friction", "N·m", f"meshing friction of stage {k}, opposing motion", f"{body}.mesh_friction.{k}"),
    )


_LIMITS = (
    ("load_cell", "the load cell's converter was at the end of its range"),
    ("set_angle", "the PLC's set angle was held at the software limit"),
    ("speed", "the drive's set velocity was held at its speed limit"),
    ("torque", "the drive's torque command was held at its torque limit"),
    ("current", "the drive's set current was held at the peak or, once I²t was full, continuous current"),
    ("voltage", "the drive's voltage was held at what the DC bus gives"),
    ("travel", "the column was beyond its travel"),
    ("bus", "the field bus lost its frames, of which there are two a cycle"),
)
"""Of drive, PLC and sensors: names as in :data:`cls_bench.control.limits.LIMITS`, and what each does."""


def topics(clock: Clock = CLOCK, stages: int = 2, axis: str = "") -> tuple[Topic, ...]:
    """All topics of an axis whose gearbox has ``stages`` stages; named ``/axis/…`` if there are several axes.

    ValueError for more stages than :data:`MOST_STAGES` or a name of an axis that is no plain word.
    """
    if not 0 <= stages <= MOST_STAGES:
        raise ValueError(f"a gearbox has 0 to {MOST_STAGES} stages, not {stages}")
    if axis and not is_axis(axis):
        raise ValueError(f'"{axis}" is no name of an axis: up to 20 of a–z, 0–9 and _, a letter first')

    def topic(path: str, ticks: int, meaning: str, *signals: tuple[str, str, str, str]) -> Topic:
        prefix = f"/{axis}" if axis else ""
        return Topic(f"{prefix}{path}", ticks, meaning, tuple(Signal(*s) for s in signals), clock.tick_ns)

    servo = "controller.state.servo"
    gearbox = topic(
        "/gearbox", 1, "The stages of the gearbox, the motor's first; each stage's torque and twist at its output "
        "shaft, friction at its input shaft.",
        *(signal for number in range(1, stages + 1) for signal in _stage(number)),
    )  # fmt: skip
    return (
        topic(
            "/pilot", clock.drive_ticks, "The hand on the grip.",
            ("hand_force", "N", "force of the hand on the grip", "truth.shown.hand_force"),
            ("squeeze", "1", "how tightly the hand grips: 0 loose, 1 rigid; −1 when it has let go",
             "truth.shown.squeeze"),
            ("limb_angle", "rad", "angle of the forearm's mass about the column's axis", "truth.shown.limb_angle"),
        ),
        topic(
            "/column", 1, "The control column.",
            ("angle", "rad", "column angle from neutral", "truth.shown.column_angle"),
            ("velocity", "rad/s", "column angular velocity", "truth.shown.column_velocity"),
            ("torque", "N·m", "torque the pilot exerts on the column", "truth.body.grip_torque"),
            ("potentiometer", "rad", "column angle from the potentiometer", "samples.potentiometer"),
        ),
        topic(
            "/drive", clock.drive_ticks, "The servo drive, at the motor shaft.",
            ("set_position", "rad", "set position of the position controller", f"{servo}.set_position"),
            ("position", "rad", "position from the encoder", "samples.encoder"),
            ("set_velocity", "rad/s", "set velocity of the velocity controller", f"{servo}.set_velocity"),
            ("velocity", "rad/s", "velocity after the speed filter", f"{servo}.velocity"),
            ("torque_command", "N·m", "torque asked of the current controller", f"{servo}.torque_command"),
            ("current", "A", "motor current (r.m.s. phase equivalent)", "samples.current"),
            ("voltage", "V", "motor voltage (power-invariant equivalent)", "truth.body.voltage"),
            ("torque", "N·m", "air-gap torque of the motor", "truth.body.motor_torque"),
            ("winding_temperature", "K", "temperature of the motor's winding above its surroundings",
             "truth.body.temperature"),
        ),
        *([gearbox] if stages else []),
        topic(
            "/load_cell", 1, "The load cell and what the controller makes of it.",
            ("force", "N", "force in the connecting rod as the strain gauge sees it, tension positive",
             "truth.body.rod_force"),
            ("torque", "N·m", "torque about the column's axis that the PLC computes from the counts, unbalance removed",
             "controller.state.plc.torque"),
            ("counts", "1", "output of the analogue-to-digital converter", "samples.load_cell"),
        ),
        topic(
            "/feel", clock.plc_ticks, "The feel model (flight control system) in the PLC.",
            ("torque", "N·m", "sum of the torques that act on the model", "controller.state.feel.torque"),
            ("angle", "rad", "column angle of the model", "controller.state.feel.angle"),
            ("velocity", "rad/s", "column angular velocity of the model", "controller.state.feel.velocity"),
            ("own_torque", "N·m", "torques of its own, but for springs: shaker, pusher, gusts, disturbance, bob-weight",
             "controller.state.feel.own_torque"),
        ),
        topic(
            "/surface", clock.plc_ticks, "The aft side of the feel model: control surface, linkage, feel unit.",
            ("deflection", "rad", "deflection δ of the surface", "controller.state.feel.surface.deflection"),
            ("velocity", "rad/s", "its angular velocity", "controller.state.feel.surface.velocity"),
            ("hinge_moment", "N·m", "aerodynamic hinge moment H at the surface, at rest",
             "controller.state.feel.surface.hinge_moment"),
            ("cable_torque", "N·m", "torque of the linkage on the aft body; 0 with one body",
             "controller.state.feel.surface.cable_torque"),
            ("feel_torque", "N·m", "restoring torque of the feel unit: springs, q-feel, centering",
             "controller.state.feel.surface.feel_torque"),
            ("autopilot_torque", "N·m", "torque of the autopilot", "controller.state.feel.surface.autopilot_torque"),
            ("trim", "rad", "where the feel unit's springs have their zero", "controller.state.feel.surface.trim"),
        ),
        topic(
            "/limits", clock.plc_ticks, "Limits that were reached, each as a share of the ticks since the row before.",
            *((name, "1", meaning, f"limits.share.{name}") for name, meaning in _LIMITS),
        ),
    )  # fmt: skip


def is_axis(name: str) -> bool:
    """Whether an axis may have that name."""
    return _AXIS.fullmatch(name) is not None


def axis_of(path: str) -> str:
    """Name of the axis of a topic or signal: ``pitch`` of ``/pitch/column``, empty if there is but one."""
    return path.rpartition("/")[0].removeprefix("/")


def axes_of(topics: Iterable[Topic]) -> tuple[str, ...]:
    """Names of the axes that ``topics`` belong to, in their order; one empty name if there is but one."""
    return tuple(dict.fromkeys(topic.axis for topic in topics))


TOPICS = topics()
"""The topics of the thesis's rig."""

TOPIC: Mapping[str, Topic] = {t.path: t for t in TOPICS}
"""The same by path."""

EVENTS_TOPIC = "/events"


@dataclass(frozen=True)
class Event:
    """Something worth a line in the log: at which tick, how grave, from where, what."""

    tick: int
    level: str
    """``"info"``, ``"warning"`` or ``"error"``."""
    source: str
    """Who says so: ``"scenario"``, ``"drive"``, ``"safety"``, ``"simulation"``."""
    message: str
    tick_ns: int = CLOCK.tick_ns
    """length of a tick [ns]; a :class:`Block` sees to it that it is its own"""

    @property
    def time(self) -> float:
        """Time since the start of the run [s]."""
        return self.tick * self.tick_ns / 1e9


class Column(NamedTuple):
    """Samples of one signal, as far as they are there."""

    ticks: NDArray[np.int64]
    """at which there is one"""
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Block:
    """All that was recorded in a run of consecutive ticks; never changed after it was yielded.

    ``signals[path]`` has shape ``(topic.rows(first_tick, ticks), len(topic.signals))``; its row 0 belongs to the first
    tick ≥ ``first_tick`` that is divisible by ``topic.ticks``. ``poses`` has shape ``(rows, bodies, 7)``: position
    [m] and quaternion (w, x, y, z) of each body of the MuJoCo model, world first, every ``clock.pose_ticks`` ticks.
    """

    first_tick: int
    ticks: int
    signals: Mapping[str, NDArray[np.float64]]
    poses: NDArray[np.float64]
    events: tuple[Event, ...] = field(default=())
    clock: Clock = CLOCK
    topics: tuple[Topic, ...] = TOPICS
    """what :attr:`signals` are, of all axes"""

    def __post_init__(self) -> None:
        if any(event.tick_ns != self.clock.tick_ns for event in self.events):
            own = tuple(replace(event, tick_ns=self.clock.tick_ns) for event in self.events)
            object.__setattr__(self, "events", own)

    @property
    def end_tick(self) -> int:
        """First tick after the block."""
        return self.first_tick + self.ticks

    def row_ticks(self, every: int) -> NDArray[np.int64]:
        """Tick numbers of the rows of a topic that is sampled every ``every`` ticks."""
        first = -(-self.first_tick // every) * every
        return np.arange(first, self.end_tick, every, dtype=np.int64)

    def topic(self, path: str) -> Topic:
        """The topic of that path. KeyError if there is none."""
        for topic in self.topics:
            if topic.path == path:
                return topic
        raise KeyError(path)

    def __getitem__(self, signal: str) -> NDArray[np.float64]:
        """Samples of a signal such as ``/column.angle``, shape (rows,)."""
        path, _, name = signal.rpartition(".")
        return self.signals[path][:, self.topic(path).names.index(name)]

    def __iter__(self) -> Iterator[tuple[Topic, NDArray[np.float64]]]:
        return ((t, self.signals[t.path]) for t in self.topics)
