"""The table of recorded signals, and the blocks in which they travel.

Every topic, signal name, unit, rate and sign is defined here and nowhere else; the tick's trace buffers, the MCAP
schemas, the Rerun entities and the documentation derive from :data:`TOPICS`.

Signs: angles are positive when the grip moves forward, away from the pilot (push); forces and torques are positive
when they act in that direction; the load cell's force is positive in tension, which is what a pushing pilot causes.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    def pose_ticks(self) -> int:
        """Ticks between two recorded sets of body poses: about 100 Hz, for the eye only."""
        return max(1, round(10_000_000 / self.tick_ns))

    def tick_of(self, time: float) -> int:
        """Number of the tick that is nearest to ``time`` [s]."""
        return round(time * 1e9 / self.tick_ns)


CLOCK = Clock()
"""The thesis's rates: 20 kHz, 5 kHz, 2.5 kHz."""

# The same under the names of old, for what does not yet know other rates.
TICK_NS, TICK_S = CLOCK.tick_ns, CLOCK.tick_s
PLC_TICKS, PLC_S = CLOCK.plc_ticks, CLOCK.plc_s
VELOCITY_TICKS, VELOCITY_S = CLOCK.velocity_ticks, CLOCK.velocity_s
POSE_TICKS = CLOCK.pose_ticks


@dataclass(frozen=True)
class Signal:
    """One recorded quantity: its name, SI unit (``"1"`` if it has none) and meaning."""

    name: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Topic:
    """Signals sampled together: a row every ``ticks`` ticks, at tick numbers divisible by ``ticks``."""

    path: str
    ticks: int
    meaning: str
    signals: tuple[Signal, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The signals' names in column order."""
        return tuple(s.name for s in self.signals)

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / (self.ticks * TICK_S)

    def rows(self, first_tick: int, ticks: int) -> int:
        """Number of rows that fall into ticks ``first_tick … first_tick + ticks − 1``."""
        return -(-(first_tick + ticks) // self.ticks) - -(-first_tick // self.ticks)


def _topic(path: str, ticks: int, meaning: str, *signals: tuple[str, str, str]) -> Topic:
    return Topic(path, ticks, meaning, tuple(Signal(*s) for s in signals))


TOPICS: tuple[Topic, ...] = (
    _topic(
        "/pilot", VELOCITY_TICKS, "The hand on the grip.",
        ("hand_force", "N", "force of the hand on the grip"),
        ("squeeze", "1", "how tightly the hand grips: 0 loose, 1 rigid; −1 when it has let go"),
        ("limb_angle", "rad", "angle of the forearm's mass about the column's axis"),
    ),
    _topic(
        "/column", 1, "The control column.",
        ("angle", "rad", "column angle from neutral"),
        ("velocity", "rad/s", "column angular velocity"),
        ("torque", "N·m", "torque the pilot exerts on the column"),
    ),
    _topic(
        "/drive", VELOCITY_TICKS, "The servo drive, at the motor shaft.",
        ("set_position", "rad", "set position of the position controller"),
        ("position", "rad", "position from the encoder"),
        ("set_velocity", "rad/s", "set velocity of the velocity controller"),
        ("velocity", "rad/s", "velocity after the speed filter"),
        ("torque_command", "N·m", "torque asked of the current controller"),
        ("current", "A", "motor current (r.m.s. phase equivalent)"),
        ("voltage", "V", "motor voltage (power-invariant equivalent)"),
        ("torque", "N·m", "air-gap torque of the motor"),
    ),
    _topic(
        "/gearbox", 1, "The two planetary stages; each stage's torque and twist at its output shaft, friction at its "
        "input shaft.",
        ("stage1_twist", "rad", "twist of stage 1, backlash included"),
        ("stage1_torque", "N·m", "torque through the mesh of stage 1"),
        ("stage1_friction", "N·m", "meshing friction of stage 1, opposing motion"),
        ("stage2_twist", "rad", "twist of stage 2, backlash included"),
        ("stage2_torque", "N·m", "torque through the mesh of stage 2"),
        ("stage2_friction", "N·m", "meshing friction of stage 2, opposing motion"),
    ),
    _topic(
        "/load_cell", 1, "The load cell and what the controller makes of it.",
        ("force", "N", "force in the connecting rod as the strain gauge sees it, tension positive"),
        ("torque", "N·m", "torque about the column's axis that the PLC computes from the counts, unbalance removed"),
        ("counts", "1", "output of the analogue-to-digital converter"),
    ),
    _topic(
        "/feel", PLC_TICKS, "The feel model (flight control system) in the PLC.",
        ("torque", "N·m", "sum of the torques that act on the model"),
        ("angle", "rad", "column angle of the model"),
        ("velocity", "rad/s", "column angular velocity of the model"),
    ),
    _topic(
        "/limits", PLC_TICKS, "Limits that were reached, each as a share of the ticks since the row before.",
        ("load_cell", "1", "the load cell's converter was at the end of its range"),
        ("set_angle", "1", "the PLC's set angle was held at the software limit"),
        ("speed", "1", "the drive's set velocity was held at its speed limit"),
        ("torque", "1", "the drive's torque command was held at its torque limit"),
        ("current", "1", "the drive's set current was held at the peak or, once I²t was full, continuous current"),
        ("voltage", "1", "the drive's voltage was held at what the DC bus gives"),
        ("travel", "1", "the column was beyond its travel"),
    ),
)  # fmt: skip

TOPIC: Mapping[str, Topic] = {t.path: t for t in TOPICS}
"""The topics by path."""

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

    @property
    def time(self) -> float:
        """Time since the start of the run [s]."""
        return self.tick * TICK_S


@dataclass(frozen=True)
class Block:
    """All that was recorded in a run of consecutive ticks; never changed after it was yielded.

    ``signals[path]`` has shape ``(topic.rows(first_tick, ticks), len(topic.signals))``; its row 0 belongs to the first
    tick ≥ ``first_tick`` that is divisible by ``topic.ticks``. ``poses`` has shape ``(rows, bodies, 7)``: position
    [m] and quaternion (w, x, y, z) of each body of the MuJoCo model, world first, every :data:`POSE_TICKS` ticks.
    """

    first_tick: int
    ticks: int
    signals: Mapping[str, NDArray[np.float64]]
    poses: NDArray[np.float64]
    events: tuple[Event, ...] = field(default=())

    @property
    def end_tick(self) -> int:
        """First tick after the block."""
        return self.first_tick + self.ticks

    def row_ticks(self, every: int) -> NDArray[np.int64]:
        """Tick numbers of the rows of a topic that is sampled every ``every`` ticks."""
        first = -(-self.first_tick // every) * every
        return np.arange(first, self.end_tick, every, dtype=np.int64)

    def __getitem__(self, signal: str) -> NDArray[np.float64]:
        """Samples of a signal such as ``/column.angle``, shape (rows,)."""
        path, _, name = signal.rpartition(".")
        return self.signals[path][:, TOPIC[path].names.index(name)]

    def __iter__(self) -> Iterator[tuple[Topic, NDArray[np.float64]]]:
        return ((t, self.signals[t.path]) for t in TOPICS)
