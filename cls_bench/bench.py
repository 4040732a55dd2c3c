"""The bench: owns model, memory and buffers, and runs a scenario block by block."""

import math
import platform
import threading
import warnings
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench import tick
from cls_bench.compiled import JIT, Callback
from cls_bench.control import plc, servo, tuning, validity
from cls_bench.controllers import failure_of
from cls_bench.errors import BenchError, ControllerError, ExitCode, InputError, one_line
from cls_bench.geometry import Geom
from cls_bench.kinematics import fit_polynomials
from cls_bench.parameters import Parameters, leaves, memory_of
from cls_bench.pilot import HandTimeline
from cls_bench.plant import model as plant_model
from cls_bench.plant import sensors, state
from cls_bench.resources import model_folder
from cls_bench.run_log import LimitLog, Trip, trip
from cls_bench.scenario import Change, Scenario, tick_of
from cls_bench.signals import PLC_TICKS, POSE_TICKS, TICK_S, TOPIC, VELOCITY_S, Block, Event
from cls_bench.step_limit import check_step
from cls_bench.trace import buffers, tables

BLOCK_TICKS = 500 * PLC_TICKS
"""Longest block: 0.2 s. A killed run loses at most this much."""


class Inputs(NamedTuple):
    """What a user's outer loop is given every 400 µs: measurements, never the plant's state."""

    time: float
    """since the start of the run [s]"""
    torque: float
    """pilot torque from the load cell, T_meas, unbalance removed [N·m]"""
    force: float
    """force in the connecting rod [N]"""
    angle: float
    """column angle from the motor encoder [rad]"""
    velocity: float
    """column velocity from the motor encoder [rad/s]"""


class Command(NamedTuple):
    """What it answers: set values of the column."""

    angle: float
    """[rad]"""
    velocity: float = 0.0
    """[rad/s]"""
    acceleration: float = 0.0
    """[rad/s²]"""
    torque: float = 0.0
    """additional torque at the column, fed forward to the current controller [N·m]"""


@runtime_checkable
class OuterLoop(Protocol):
    """A user's own outer loop: a plain Python object."""

    def step(self, inputs: Inputs) -> Command:
        """Called every 400 µs while the drive is on."""
        ...


class DivergedError(BenchError):
    """The run left all bounds; what was recorded until then stays."""

    exit_code = ExitCode.DIVERGED

    def __init__(self, time: float, cause: str):
        super().__init__(f"diverged at t = {time:.4f} s: {cause}")
        self.time = time
        self.cause = cause


class Bench:
    """The rig with one set of parameters, from standstill at neutral.

    ``seed`` seeds the sensors' noise. ``controller`` replaces the feel model in the PLC by a user's own outer loop.
    Raises :class:`InputError` if the parameters make a model that cannot be stepped, and MemoryError.
    """

    def __init__(self, parameters: Parameters, *, seed: int = 0, controller: OuterLoop | None = None):
        if controller is not None and not isinstance(controller, OuterLoop):
            raise InputError(f"controller {type(controller).__name__} has no method step(inputs)")
        self.controller = controller
        check_step(parameters)
        try:
            self.model: Any = plant_model.stepped_spec(parameters).compile()
        except ValueError as error:
            if "allocate" in str(error):  # MuJoCo tells of it as of a wrong model
                raise MemoryError("no memory is left for the model") from None
            raise InputError(f"these parameters make no valid model: {str(error).splitlines()[0]}") from None
        self._built = parameters
        self.data: Any = mujoco.MjData(self.model)
        self.plant = state.view(self.model, self.data)
        self._rng = np.random.Generator(np.random.PCG64(seed))
        memory = np.zeros(1, dtype=tick.STATE)
        self._state: Any = memory.view(np.recarray)[0]
        self._numbers = validity.numbers(memory)
        self.trips: list[Trip] = []
        """trips of the drive, in order"""
        self._limits = LimitLog()
        self._outer_loop = _Asking(controller, memory)
        self._tick = 0
        self.plant.tendon_stiffness[state.GRIP] = 0.0  # the hand grips when the scenario says so
        self.plant.tendon_damping[state.GRIP] = 0.0
        self._apply(parameters)

    @property
    def time(self) -> float:
        """Time simulated so far [s]."""
        return self._tick * TICK_S

    def compile(self) -> None:
        """Have the loop's machine code ready: compiled once for each version of the sources, then from the cache."""
        none = np.zeros(0)
        hand = tick.Hand(none, none, none, np.zeros(0, np.bool_), np.zeros(0, np.bool_), none)
        noise = np.zeros((0, sensors.NOISES))
        self._advance(hand, noise, buffers(0, 0, self.model.nbody), 0, 0)

    @property
    def mjcf(self) -> Mapping[str, bytes]:
        """The complete model as run, and the files it was made from, by file name."""
        files = {name: (model_folder() / name).read_bytes() for name in ("cls_bench.xml", "scene.xml")}
        spec, _ = self._drawn
        return {"bench_as_run.xml": spec.to_xml().encode(), **files}

    @cached_property
    def _drawn(self) -> tuple[mujoco.MjSpec, Any]:
        """The same bench with all that is to be seen of it."""
        spec = plant_model.build_spec(self._built)
        return spec, spec.compile()

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of the bodies, world first."""
        return tuple(self.model.body(i).name for i in range(self.model.nbody))

    @property
    def geoms(self) -> tuple[Geom, ...]:
        """The shapes of all bodies."""
        _, m = self._drawn

        def numbers(values: Any) -> Any:
            return tuple(float(v) for v in values)

        return tuple(
            Geom(
                int(m.geom_bodyid[i]),
                mujoco.mjtGeom(int(m.geom_type[i])).name.removeprefix("mjGEOM_").lower(),
                numbers(m.geom_size[i]), numbers(m.geom_pos[i]), numbers(m.geom_quat[i]), numbers(m.geom_rgba[i]),
            )
            for i in range(m.ngeom)
        )  # fmt: skip

    def _apply(self, parameters: Parameters) -> None:
        """Take over ``parameters``, at the start or for a change of live ones in mid-run."""
        self.parameters = parameters
        memory = memory_of(parameters)
        self._record = memory.view(np.recarray)[0]
        self._watched = tick.Watched(self._numbers, validity.numbers(memory))
        plant_model.set_limb_mass(self.model, parameters.limb.mass)
        reach = parameters.kinematic_range
        try:
            polynomials = fit_polynomials(parameters.linkage.four_bar, reach, parameters.plc.polynomial_degree)
        except ValueError as error:
            raise InputError(f"parameters.linkage: {error}") from None
        self._constants = tick.Constants(
            gains=tuning.design(self._record.drive, self._record.motor, VELOCITY_S),
            dampings=plant_model.dampings(parameters),
            bar=parameters.linkage.four_bar,
            polynomials=polynomials,
            mesh_loss=parameters.gearbox.mesh_loss,
            unbalance=plant_model.static_unbalance(parameters),
            newtons_per_count=float(sensors.load_cell_count(self._record.load_cell)),
            voltage_limit=parameters.drive.voltage_limit,
        )

    def run(self, scenario: Scenario) -> Iterator[Block]:
        """Run ``scenario``; yields a block for every 0.2 s at most. A bench runs once.

        Raises :class:`DivergedError` when a state leaves all bounds and :class:`ControllerError` when a user's outer
        loop fails, in both cases after the last good block was yielded with an error event in it.
        """
        if self._tick:
            raise RuntimeError("this bench has run already; make a new one")
        timeline = HandTimeline(scenario)
        changes = sorted(scenario.changes, key=lambda change: change.at)
        self._start(scenario)
        end = self._end = -(-scenario.ticks // PLC_TICKS) * PLC_TICKS
        while self._tick < end:
            events = []
            while changes and _cycle_start(changes[0]) <= self._tick:
                events += self._change(changes.pop(0))
            until = min(end, self._tick + BLOCK_TICKS, *(_cycle_start(change) for change in changes[:1]))
            yield from self._block(timeline, until - self._tick, events)

    def _start(self, scenario: Scenario) -> None:
        self._state.servo.mode = (
            servo.VELOCITY if self.parameters.plc.outer_loop == "velocity" else servo.POSITION
        )
        self._state.power = int(scenario.drive.power == "on")

    def _change(self, change: Change) -> list[Event]:
        """Carry out a change; returns what the log says of it."""
        said = []
        if change.parameters:
            before = leaves(self.parameters)
            after = change.apply(self.parameters)
            said += [
                f"{key} = {value}" + ("" if info["unit"] == "1" else f" {info['unit']}")
                for (key, value, info), (_, old, _) in zip(leaves(after), before, strict=True) if value != old
            ]
            self._apply(after)
        if change.mode is not None:
            self._state.servo.mode = servo.MODES.index(change.mode)
            said.append(f"drive mode {change.mode}")
        if change.power is not None:
            self._state.power = int(change.power == "on")
            self._state.plc.trip = plc.NO_TRIP
            said.append(f"drive power {change.power}")
        return [Event(self._tick, "info", "scenario", line) for line in said]

    def _block(self, timeline: HandTimeline, ticks: int, events: list[Event]) -> Iterator[Block]:
        first = self._tick
        hand = tick.Hand.of(timeline.sample(first, ticks))
        noise = self._rng.standard_normal((ticks, sensors.NOISES))
        trace = buffers(first, ticks, self.model.nbody)
        powered = self._state.power
        failure: BaseException | None = None
        with self._warnings() as warned:
            done = self._advance(hand, noise, trace, first, ticks)
        if done < ticks:
            failure = self._outer_loop.failure or DivergedError((first + done) * TICK_S, self._lost(warned))
        signals = tables(trace, first, done)
        if (lost := _first_lost(signals, first)) is not None:
            at, signal = lost
            done = at - first
            failure = DivergedError(at * TICK_S, f"recorded signal {signal} is not finite")
            signals = tables(trace, first, done)
        events += self._limits.read(first, first + done, signals["/limits"], self._state.limits)
        if powered and not self._state.power:
            self.trips.append(trip(int(self._state.trip_tick), int(self._state.plc.trip), self._invalid()))
            events.append(self.trips[-1].event)
        last = max(first + done - 1, first)
        events += [Event(last, "warning", "simulation", message) for message in warned]
        if failure is not None:
            events.append(Event(last, "error", "simulation", str(failure) or "interrupted"))
        self._tick = first + done
        if failure is not None or self._tick >= self._end:
            events += self._limits.finish(last)
        if done or failure is not None:
            rows = -(-(first + done) // POSE_TICKS) - -(-first // POSE_TICKS)
            yield Block(first, done, signals, trace.poses[:rows], tuple(events))
        if failure is not None:
            raise failure

    def _advance(self, hand: Any, noise: Any, trace: Any, first: int, ticks: int) -> int:
        return tick.advance(
            self.plant, self._record, self._constants, self._state, self._watched, hand, noise, trace, first, ticks,
            self.controller is not None, self._outer_loop.ask,
        )  # fmt: skip

    @contextmanager
    def _warnings(self) -> Iterator[list[str]]:
        """Collect MuJoCo's warnings, and have the tick stop at the first; by itself MuJoCo writes them to a file."""
        warned: list[str] = []

        def log(message: str) -> None:
            warned.append(" ".join(message.split()))
            self._state.warned = 1

        mujoco.set_mju_user_warning(_hear)
        _listening.log = log
        try:
            yield warned
        finally:
            _listening.log = None

    def _lost(self, warned: list[str]) -> str:
        """What a run that left all bounds was lost by."""
        joint = tick.first_unbounded(self.plant)
        if joint >= 0:
            return f"velocity of joint {state.JOINTS[joint]} is not finite or out of all bounds"
        return f"MuJoCo warned: {warned[0]}"

    def _invalid(self) -> str:
        """The number that the controller's self-check found last."""
        of_state = validity.names(tick.STATE)
        found = int(self._state.invalid)
        if found < len(of_state):
            return of_state[found][0]
        return validity.names(memory_of(self.parameters).dtype)[found - len(of_state)][0]


_listening = threading.local()
"""To whom MuJoCo's warnings go: the bench that runs in the thread. MuJoCo has one handler for all threads."""


def _hear(message: str) -> None:
    if (log := getattr(_listening, "log", None)) is not None:
        log(message)
    else:  # someone else's simulation
        warnings.warn(message, RuntimeWarning, stacklevel=2)


class _Asking:
    """Asks a user's outer loop from within the compiled loop."""

    alive: ClassVar["weakref.WeakSet[_Asking]"] = weakref.WeakSet()
    """All there are, for whoever watches that the user's code comes back."""

    def __init__(self, controller: OuterLoop | None, memory: Any):
        self.failure: BaseException | None = None
        """why the loop was stopped"""
        self.asked = self.answered = -1
        """tick of the last question and of the last answer"""
        self.ask = Callback(self._ask)
        self._controller = controller
        # Plain arrays: the fields of a record would take longer to reach than all the rest.
        self._plc = memory["plc"][0:1].view(np.float64)
        self._model = memory["feel"][0:1].view(np.float64)
        if controller is not None:
            self.alive.add(self)

    def _ask(self, at: int) -> int:
        force, torque, angle, velocity = self._plc[:4].tolist()
        self.asked = at
        try:
            command = _answer(self._controller, Inputs(at * TICK_S, torque, force, angle, velocity))
        except BaseException as error:  # none may pass through the compiled loop, not even Ctrl-C
            self.failure = error
            return 1
        finally:
            self.answered = at
        self._plc[4:8] = command
        self._model[[0, 1, 3]] = command.angle, command.velocity, torque
        return 0


def _answer(controller: Any, inputs: Inputs) -> Command:
    """The user's command; ControllerError of one line if there is none that can be used, whatever was raised."""
    try:
        answer = controller.step(inputs)
        command = _command(answer)
    except BaseException as error:
        what = f"{type(controller).__name__}.step failed at t = {inputs.time:.4f} s"
        raise failure_of(what, error) from error
    if command is None:
        try:
            shown = one_line(repr(answer))
        except BaseException:  # whatever a user's __repr__ may raise
            shown = f"a {type(answer).__name__}"
        raise ControllerError(
            f"{type(controller).__name__}.step returned {shown} at t = {inputs.time:.4f} s; "
            f"a Command of finite numbers is valid: {', '.join(Command._fields)}"
        )
    return command


def _command(answer: Any) -> Command | None:
    """The answer as finite floats; None if it is no Command, or not of numbers."""
    if type(answer) is Command and set(map(type, answer)) == _FLOATS and math.isfinite(sum(answer)):
        return answer
    if not isinstance(answer, (tuple, list, np.ndarray)) or not 1 <= len(answer) <= len(Command._fields):
        return None
    numbers = list(answer)
    if not all(isinstance(x, (int, float, np.integer, np.floating)) and not isinstance(x, bool) for x in numbers):
        return None
    try:
        command = Command(*map(float, numbers))
    except OverflowError:
        return None
    return command if all(map(math.isfinite, command)) else None


_FLOATS = {float}


def _cycle_start(change: Change) -> int:
    """Changes take effect with the next PLC cycle, at most 400 µs after their time."""
    return -(-tick_of(change.at) // PLC_TICKS) * PLC_TICKS


def _first_lost(signals: Mapping[str, NDArray[np.float64]], first: int) -> tuple[int, str] | None:
    """Tick and name of the first recorded sample that is not a finite number; None if all are."""
    found: list[tuple[int, str]] = []
    for path, table in signals.items():
        if not np.isfinite(table).all():
            row, column = np.argwhere(~np.isfinite(table))[0].tolist()
            topic = TOPIC[path]
            found.append(((-(-first // topic.ticks) + row) * topic.ticks, f"{path}.{topic.names[column]}"))
    return min(found, default=None)


def versions() -> dict[str, str]:
    """Versions on which the samples depend."""
    from importlib.metadata import version

    packages = {name: version(name) for name in ("cls-bench", "mujoco", "numba", "numpy", "scipy")}
    return {**packages, "python": platform.python_version(), "jit": "on" if JIT else "off"}
