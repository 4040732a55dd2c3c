"""The bench: owns model, memory and buffers of one axis or several, and steps them.

It is told what the hands do and what changes, and knows no scenario: scripted runs, sweeps, live use and a host link
are drivers on top (:mod:`cls_bench.drivers`).
"""

import math
import platform
import threading
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench import course, tick
from cls_bench.axis import AXIS, NUMBERS, WORDS, forget, set_parameters
from cls_bench.compiled import JIT, records
from cls_bench.control import plc, servo
from cls_bench.control.controller import Watched
from cls_bench.control.outer_loop import Asking, OuterLoop
from cls_bench.controllers import failure_of
from cls_bench.course import Course
from cls_bench.errors import BenchError, ExitCode, InputError
from cls_bench.geometry import Geom
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters, Simulation, leaves
from cls_bench.parameters.moving import STEPPED, numbers, replaced
from cls_bench.parameters.override import bounds, known_keys
from cls_bench.plant import mechanism, mjcf, sensors, state
from cls_bench.plant import model as plant_model
from cls_bench.resources import model_folder
from cls_bench.run_log import LimitLog, Trip, source_of, trip
from cls_bench.signals import Block, Event, Topic, is_axis, topics
from cls_bench.step_limit import check_step
from cls_bench.trace import Buffers

LONGEST_BLOCK = 0.2
"""Longest block [s]. A killed run loses at most this much."""


class DivergedError(BenchError):
    """The run left all bounds; what was recorded until then stays."""

    exit_code = ExitCode.DIVERGED

    def __init__(self, time: float, cause: str):
        super().__init__(f"diverged at t = {time:.4f} s: {cause}")
        self.time = time
        self.cause = cause


class Axis(NamedTuple):
    """One axis of a bench."""

    name: str
    """empty if it is the only one"""
    record: Any
    """its :data:`cls_bench.axis.AXIS`, in the bench's memory"""
    watch: Any
    """what the tick noted of its limits, there"""
    topics: tuple[Topic, ...]
    trips: list[Trip]
    limits: LimitLog


class Bench:
    """One axis or several with one set of parameters each, from standstill at neutral.

    ``parameters`` are those of the only axis, or of each by name. ``seed`` seeds the sensors' noise; each sensor has a
    random stream of its own. Axes whose plants need steps of different length are stepped by the shortest.
    ``controller`` replaces the feel model in the PLC by a user's own outer loop, or those of
    some axes by name. Without ``poses`` the bodies' are left out, which a sweep has no use for. Raises
    :class:`InputError` if the parameters make a model that cannot be stepped, and MemoryError.
    """

    def __init__(
        self, parameters: Parameters | Mapping[str, Parameters], *, seed: int = 0,
        controller: "OuterLoop | Mapping[str, OuterLoop] | None" = None, poses: bool = True,
    ):  # fmt: skip
        self._built = {"": parameters} if isinstance(parameters, Parameters) else dict(parameters)
        self._controllers: dict[str, OuterLoop] = dict(controller) if isinstance(controller, Mapping) else (
            {} if controller is None else {next(iter(self._built)): controller}
        )
        for loop in self._controllers.values():
            if not isinstance(loop, OuterLoop):
                raise InputError(f"controller {type(loop).__name__} has no method step(inputs)")
        _check_together(self._built)
        for name in self._controllers:
            if name not in self._built:
                raise InputError(f"controller of axis {name!r}: there is {', '.join(map(repr, self._built))}")
        self._simulation = _finest(self._built)
        for p in self._built.values():
            check_step(self._stepped(p))
        try:
            self.model: Any = plant_model.build({name: self._stepped(p) for name, p in self._built.items()})
        except ValueError as error:
            if "allocate" in str(error):  # MuJoCo tells of it as of a wrong model
                raise MemoryError("no memory is left for the model") from None
            raise InputError(f"these parameters make no valid model: {str(error).splitlines()[0]}") from None
        self.data: Any = mujoco.MjData(self.model)
        self.plant = state.view(self.model, self.data)
        first = next(iter(self._built.values()))
        self.clock = first.rates.clock
        self._cycles = tick.Cycles(
            self.clock.velocity_ticks, self.clock.position_ticks, self.clock.bus_ticks, self.clock.plc_ticks,
            self.clock.drive_ticks, self.clock.pose_ticks, self._simulation.substeps,
        )  # fmt: skip
        self.block_ticks = max(1, round(LONGEST_BLOCK / self.clock.plc_s)) * self.clock.plc_ticks
        """longest block that :meth:`advance` runs [ticks]"""
        memory = np.zeros(len(self._built), AXIS)
        self._memory = records(memory)
        self._axes = memory.view(np.recarray)
        self.axes = tuple(
            Axis(
                name, self._axes[a], self._axes[a].limits, topics(self.clock, p.gearbox.stages, name), [],
                LimitLog(self.clock, name),
            )
            for a, (name, p) in enumerate(self._built.items())
        )
        """the axes, in order"""
        for axis, p in zip(self.axes, self._built.values(), strict=True):
            plant_model.find_joints(self.model, axis.name, p.gearbox.stages, axis.record.truth.joints)
        self._recorded = [axis.topics for axis in self.axes]
        self._power = memory["controller"]["state"]["power"]
        self.topics = tuple(topic for axis in self.axes for topic in axis.topics)
        """what is recorded"""
        words = memory.view(np.float64, np.ndarray).reshape(len(memory), -1)
        self._words = words
        self._watched = Watched(words, NUMBERS[0].words, NUMBERS[1].words)
        self._posed = poses
        self.body_names = mjcf.body_names(self._built)
        """names of the drawn bodies, world first"""
        self._bodies = _bodies(self._built if poses else {})
        self._warned = np.zeros(1, np.int64)
        self._outer_loop = Asking(
            [self._controllers.get(name) for name in self._built],
            [memory[a : a + 1]["controller"]["state"] for a in range(len(memory))], self.clock.tick_s, failure_of,
        )  # fmt: skip
        self.reset(seed=seed)

    def reset(self, parameters: Parameters | Mapping[str, Parameters] | None = None, *, seed: int = 0) -> None:
        """Go back to standstill at neutral, as if made anew, with other ``parameters`` if given.

        They need the same axes, stages, kind of linkage and rates as before: ValueError otherwise. Raises InputError
        as :class:`Bench` does.
        """
        if parameters is not None:
            built = {"": parameters} if isinstance(parameters, Parameters) else dict(parameters)
            if self._shape(built) != self._shape(self._built):
                raise ValueError("other axes, stages, rates, substeps or another kind of linkage need a new bench")
            for p in built.values():
                check_step(self._stepped(p))
            self._built = built
            self.__dict__.pop("_drawn", None)
            if self._posed:
                self._bodies = _bodies(built)
        self._parameters = dict(self._built)  # of each axis, but for those that have moved since
        self._moved: dict[str, set[str]] = {name: set() for name in self._built}
        self._following: dict[tuple[str, str], tuple[course.Place, Course]] = {}  # by axis and key
        self._courses = course.tables([])
        self._waiting: list[Event] = []  # what courses have to say later
        mujoco.mj_resetData(self.model, self.data)
        for axis, p in zip(self.axes, self._built.values(), strict=True):
            forget(axis.record, p)
            axis.record.controller.state.external = int(axis.name in self._controllers)
            self._apply(axis, p)
            axis.trips.clear()
            axis.limits.reset()
        self._streams = _Streams(tuple(self._built), seed)
        self._buffers: Buffers | None = None
        self._events: list[Event] = []
        self._tick = 0
        self._warned[0] = 0
        self._outer_loop.failure = None
        self.failure: BaseException | None = None
        """why the run ended before its time"""

    @staticmethod
    def _shape(built: Mapping[str, Parameters]) -> Any:
        return _finest(built), [(name, p.gearbox.stages, p.linkage.kind, p.rates) for name, p in built.items()]

    def _stepped(self, p: Parameters) -> Parameters:
        """The parameters of an axis with the steps in which all are stepped."""
        return p if p.simulation == self._simulation else p.model_copy(update={"simulation": self._simulation})

    @property
    def time(self) -> float:
        """Time simulated so far [s]."""
        return self.clock.time(self._tick)

    @property
    def next_tick(self) -> int:
        """Number of the next tick."""
        return self._tick

    @property
    def parameters(self) -> Parameters:
        """Parameters of the first axis as they are now."""
        return self._now(next(iter(self._built)))

    @property
    def parameters_of(self) -> Mapping[str, Parameters]:
        """Parameters of each axis as they are now, by name."""
        return {name: self._now(name) for name in self._built}

    def _now(self, axis: str) -> Parameters:
        """The parameters of an axis, those that have moved as they stand in its record."""
        if self._moved[axis]:
            words = self._words[list(self._built).index(axis)]
            moved = {key: float(words[WORDS[key]]) for key in self._moved[axis]}
            self._parameters[axis] = replaced(self._parameters[axis], moved)
            self._moved[axis] = {key for name, key in self._following if name == axis}
        return self._parameters[axis]

    @property
    def trips(self) -> list[Trip]:
        """Trips of the drives, in order."""
        return sorted((found for axis in self.axes for found in axis.trips), key=lambda found: found.tick)

    def compile(self) -> None:
        """Have the loop's machine code ready: compiled once for each version of the sources, then from the cache."""
        none = np.zeros((0, len(self.axes)))
        hand = tick.Hand(none, none, none, none.astype(np.bool_), none.astype(np.bool_), none)
        empty = Buffers(self.clock, len(self.axes), len(self._bodies.axis), 0, 0)
        self._advance(hand, sensors.Noise(*[none] * len(sensors.Noise._fields)), empty.part(0, 0), 0)

    @property
    def mjcf(self) -> Mapping[str, bytes]:
        """The bench as a complete MJCF for viewers and pictures, and the files it was made from, by file name.

        It is the same rig in MuJoCo's own elements (:mod:`cls_bench.plant.mjcf`), with shapes, tendons and a linkage
        closed by a constraint; what is stepped is :attr:`model` under the laws of :mod:`cls_bench.plant`.
        """
        files = {name: (model_folder() / name).read_bytes() for name in ("cls_bench.xml", "scene.xml")}
        spec, _ = self._drawn
        return {"bench.xml": spec.to_xml().encode(), **files}

    @cached_property
    def _drawn(self) -> tuple[mujoco.MjSpec, Any]:
        """The same bench with all that is to be seen of it."""
        spec = mjcf.build_bench(self._built)
        return spec, spec.compile()

    @property
    def geoms(self) -> tuple[Geom, ...]:
        """The shapes of all bodies."""
        _, m = self._drawn
        found = [m.body(i).name for i in range(m.nbody)]
        number = {i: self.body_names.index(name) for i, name in enumerate(found)}

        def numbers(values: Any) -> Any:
            return tuple(float(v) for v in values)

        return tuple(
            Geom(
                number[int(m.geom_bodyid[i])],
                mujoco.mjtGeom(int(m.geom_type[i])).name.removeprefix("mjGEOM_").lower(),
                numbers(m.geom_size[i]), numbers(m.geom_pos[i]), numbers(m.geom_quat[i]), numbers(m.geom_rgba[i]),
            )
            for i in range(m.ngeom)
        )  # fmt: skip

    def _apply(self, axis: Axis, parameters: Parameters) -> None:
        """Take over ``parameters``, at the start or for a change of live ones in mid-run."""
        set_parameters(axis.record, self._stepped(parameters))
        self._parameters[axis.name] = parameters
        plant_model.set_weights(self.model, axis.name, parameters)
        self._bound = tick.bound(self._parameters.values())
        woken = [{**sensors.woken(p), **plc.woken(p.plc, p.feel)} for p in self._parameters.values()]
        self._chances = [[each[source] for each in woken] for source in (*sensors.UNIFORM, *sensors.TURBULENCE)]

    def _named(self, name: str) -> Axis:
        for axis in self.axes:
            if axis.name == name:
                return axis
        raise InputError(f"axis {name!r}: there is {', '.join(repr(axis.name) for axis in self.axes)}")

    def change(
        self, parameters: Parameters | None = None, *, mode: str | None = None, power: str | None = None,
        axis: str = "", said: str | None = None,
    ) -> None:  # fmt: skip
        """Change live parameters of an axis, its drive's mode or power, from the next tick on; the log says so, of
        parameters in the words of ``said`` if that is given, or nothing if it is empty.

        A parameter that moves and is given another value than its present one moves no more; the others go on.
        Raises InputError, and changes nothing, for a parameter that is not live or that the plant's step cannot carry,
        and a mode or power that is none.
        """
        changed = self._named(axis)
        state_record = changed.record.controller.state
        for name, value, valid in (("mode", mode, servo.MODES), ("power", power, ("on", "off"))):
            if value is not None and value not in valid:
                raise InputError(f"{name} {value!r} is not valid; give one of {', '.join(valid)}")
        lines: list[str] = []
        if parameters is not None:
            found = list(_differences(parameters, self._now(axis)))
            for key, _, info in found:
                if not info["live"]:
                    raise InputError(f"parameters.{key}: holds for the whole run; reset the bench with another")
            check_step(self._stepped(parameters))
            lines += [value_line(key, new, info["unit"]) for key, new, info in found] if said is None else []
            lines += [said] if said else []
            if any([self._following.pop((axis, key), None) is not None for key, _, _ in found]):
                self._take_up()
            self._apply(changed, parameters)
        if mode is not None:
            state_record.servo.mode = servo.MODES.index(mode)
            lines.append(f"drive mode {mode}")
        if power is not None:
            state_record.power = int(power == "on")
            state_record.plc.trip = plc.NO_TRIP
            lines.append(f"drive power {power}")
        self._events += [Event(self._tick, "info", source_of(axis, "scenario"), line) for line in lines]

    def follow(
        self, courses: Mapping[str, Course], *, axis: str = "", rates: Mapping[str, float] | None = None
    ) -> None:  # fmt: skip
        """Let live parameters of an axis, by dotted key, follow courses from now on; each replaces an earlier one.

        Their values are written in each PLC cycle, in compiled code, whatever the blocks: nothing is worked out from
        step to step in Python, and no block need end where a course does something. ``rates`` are the greatest changes
        allowed in a second, by key [unit/s]. A host that gives new values every 10 ms leads them there (:meth:`lead`).

        Raises InputError, and changes nothing, for a parameter that is not live or no number, of which more follows
        than its place in the record (:data:`cls_bench.parameters.moving.STEPPED`: change those), or with a value that
        is out of its bounds. Rules that join several parameters, and the plant's step, are for the caller to check:
        with :meth:`change` they are.
        """
        followed = self._named(axis)
        for key, found in courses.items():
            low, high = _check_movable(key)
            for bound in (found.low, found.high):
                if not low <= bound <= high:
                    raise InputError(f"parameters.{key}: {bound:g} is not valid; it must be {_valid(key)}")
        self._follow(courses, followed, rates)
        source = source_of(axis, "scenario")
        self._waiting += [Event(at, "info", source, line) for found in courses.values() for at, line in found.said]
        self._waiting.sort(key=lambda event: event.tick)

    def _follow(self, courses: Mapping[str, Course], axis: Axis, rates: Mapping[str, float] | None) -> None:
        number, taken = self.axes.index(axis), {}
        for key, found in courses.items():
            rate = (rates or {}).get(key, math.inf)
            if not rate > 0.0:
                raise InputError(f"parameters.{key}: a rate of {rate:g} 1/s is not valid; give a number > 0")
            place = course.Place(number, WORDS[key], *bounds(key), rate * self.clock.plc_s)
            taken[axis.name, key] = place, found
        self._now(axis.name)
        self._following.update(taken)
        self._moved[axis.name] |= set(courses)
        self._take_up()

    def lead(
        self, values: Mapping[str, float], over: float, *, axis: str = "", rates: Mapping[str, float] | None = None
    ) -> None:  # fmt: skip
        """Lead live parameters of an axis from their present values in straight lines to ``values`` within ``over``
        [s].

        For values from outside: what is no number, or out of its bounds, is no error. The compiled loop does not take
        the one, goes to the bound instead of the other, and counts both (:attr:`refused`). The log says nothing.
        Otherwise as :meth:`follow`.
        """
        led = self._named(axis)
        words, span = self._words[self.axes.index(led)], over / self.clock.tick_s
        for key in values:
            _check_movable(key)
        self._follow(
            {
                key: Course(course.ramp(self._tick, span, float(words[WORDS[key]]), float(value)))
                for key, value in values.items()
            },
            led, rates,
        )  # fmt: skip

    def _take_up(self) -> None:
        """Have the tick write the courses that there are."""
        reached = self._courses[0]
        kept = {(int(c.axis), int(c.word)): int(c.refused) for c in reached.view(np.recarray)}
        self._courses = course.tables([(place, found.pieces) for place, found in self._following.values()])
        for row in self._courses[0].view(np.recarray):
            row.refused = kept.get((int(row.axis), int(row.word)), 0)

    @property
    def refused(self) -> Mapping[tuple[str, str], int]:
        """PLC cycles in which a course's value was none or out of bounds, by axis and key, of those that are followed.
        """
        return {
            found: int(row.refused)
            for found, row in zip(self._following, self._courses[0].view(np.recarray), strict=True)
        }  # fmt: skip

    def start(self, *, power: bool = True) -> None:
        """Switch the drives on, or leave them off; once, before the first :meth:`advance`."""
        if self._tick:
            raise RuntimeError("this bench has run already; reset it")
        for axis in self.axes:
            axis.record.controller.state.power = int(power)

    def advance(self, hand: HandSamples | Sequence[HandSamples] | tick.Hand, *, last: bool = False) -> Block:
        """Run as many ticks as ``hand`` (of the only axis, or of each) has entries; returns what was recorded.

        A whole number of PLC cycles, but in the ``last`` block of a run, which also closes what the log keeps open; at
        most :attr:`block_ticks`. A state that leaves all bounds, or a user's outer loop that fails, ends the block
        early, with an error event in it: :attr:`failure` then says why, and the bench runs no more until it is reset.
        """
        if self.failure is not None:
            raise RuntimeError("this run has failed; reset the bench")
        if isinstance(hand, HandSamples):
            hand = [hand]
        hands: tick.Hand = hand if isinstance(hand, tick.Hand) else tick.Hand.of(hand)
        first, ticks = self._tick, len(hands.angle)
        if not 0 < ticks <= self.block_ticks or first % self.clock.plc_ticks:
            raise ValueError(f"a block has whole PLC cycles, and at most {self.block_ticks} ticks; this one {ticks}")
        if any(values.shape != (ticks, len(self.axes)) for values in hands):  # compiled code looks at no bounds
            raise ValueError(f"a hand for each axis: there are {len(self.axes)}, and {hands.angle.shape[1]} hands")
        noise = self._streams.draw(ticks, self._chances)
        trace = self._room(first, ticks)
        powered = self._power.tolist()
        with self._warnings() as warned:
            done = self._advance(hands, noise, trace, ticks)
        if done < ticks:
            self.failure = self._outer_loop.failure or DivergedError(self.clock.time(first + done), self._lost(warned))
        signals = self._tables(first, done)
        if (lost := self._first_lost(signals, first)) is not None:
            at, signal = lost
            done = at - first
            self.failure = DivergedError(self.clock.time(at), f"recorded signal {signal} is not finite")
            signals = self._tables(first, done)
        events = self._log(first, done, signals, powered, warned)
        self._tick = first + done
        self._leave_behind()
        if self.failure is not None or last:
            events += [event for axis in self.axes for event in axis.limits.finish(max(self._tick - 1, first))]
        rows = -(-self._tick // self.clock.pose_ticks) - -(-first // self.clock.pose_ticks)
        return Block(first, done, signals, trace.poses[:rows], tuple(events), self.clock, self.topics)

    def _room(self, first: int, ticks: int) -> Any:
        """Trace buffers for the block, cut from room that is made for the longest one."""
        room = self._buffers
        if room is None or first + ticks > room.first_tick + room.ticks:
            room = Buffers(self.clock, len(self.axes), len(self._bodies.axis), first, max(self.block_ticks, ticks))
            self._buffers = room
        return room.part(first, ticks)

    def _tables(self, first: int, ticks: int) -> Mapping[str, NDArray[np.float64]]:
        assert self._buffers is not None
        return self._buffers.tables(self._recorded, first, ticks)

    def _advance(self, hand: Any, noise: Any, trace: Any, ticks: int) -> int:
        return tick.advance(
            self.plant, self._memory, self._watched, hand, noise, trace, self._bodies, self._cycles,
            *self._courses, self._bound, self._warned, self._tick, ticks, self._outer_loop.ask.address,
        )  # fmt: skip

    def _log(
        self, first: int, done: int, signals: Mapping[str, NDArray[np.float64]], powered: Sequence[int],
        warned: Sequence[str],
    ) -> list[Event]:  # fmt: skip
        events, self._events = self._events, []
        while self._waiting and self._waiting[0].tick < first + max(done, 1):
            events.append(self._waiting.pop(0))
        for axis, was_on, is_on in zip(self.axes, powered, self._power.tolist(), strict=True):
            events += axis.limits.read(first, first + done, signals[axis.limits.path], axis.watch)
            if was_on and not is_on:
                control = axis.record.controller.state
                axis.trips.append(
                    trip(self.clock, axis.name, int(control.trip_tick), int(control.plc.trip), self._invalid(control))
                )
                events.append(axis.trips[-1].event)
        at = max(first + done - 1, first)
        events += [Event(at, "warning", "simulation", message) for message in warned]
        if self.failure is not None:
            events.append(Event(at, "error", "simulation", str(self.failure) or "interrupted"))
        return events

    def _leave_behind(self) -> None:
        """Follow no course any more that has come to its end, and whose value has arrived there."""
        over = [
            name for name, (place, found) in self._following.items()
            if found.end < self._tick and self._words[place.axis, place.word] == found.pieces[-1]["end"]
        ]  # fmt: skip
        if over:
            for found in over:
                del self._following[found]
            for axis in self._built:  # where they have come to is read once more, and then they count as moved no more
                self._now(axis)
            self._take_up()

    @staticmethod
    def _invalid(control: Any) -> str:
        """The number that the controller's self-check found last."""
        names = (*NUMBERS[0].names, *NUMBERS[1].names)
        return names[int(control.invalid)]

    @contextmanager
    def _warnings(self) -> Iterator[list[str]]:
        """Collect MuJoCo's warnings, and have the tick stop at the first; by itself MuJoCo writes them to a file."""
        warned: list[str] = []

        def log(message: str) -> None:
            warned.append(" ".join(message.split()))
            self._warned[0] = 1

        mujoco.set_mju_user_warning(_hear)
        _listening.log = log
        try:
            yield warned
        finally:
            _listening.log = None

    def _lost(self, warned: Sequence[str]) -> str:
        """What a run that left all bounds was lost by."""
        joint = tick.first_unbounded(self.plant, self._bound)
        if joint >= 0:
            return f"velocity of joint {self.model.joint(joint).name} is not finite or out of all bounds"
        for axis in self.axes:
            body = axis.record.truth.body
            for name in mechanism.REMEMBERED:
                if not math.isfinite(body[name]):
                    return f"{plant_model.prefixed(axis.name, name)} in the plant is not finite"
        return f"MuJoCo warned: {warned[0]}"

    def _first_lost(self, signals: Mapping[str, NDArray[np.float64]], first: int) -> tuple[int, str] | None:
        """Tick and name of the first recorded sample that is not a finite number; None if all are."""
        found: list[tuple[int, str]] = []
        # The sum of numbers that are finite is finite, but for such that no plant has: quicker than a look at each.
        with np.errstate(all="ignore"):
            suspect = [t for t in self.topics if not math.isfinite(np.add.reduce(signals[t.path], axis=None))]
        for topic in suspect:
            table = signals[topic.path]
            if not np.isfinite(table).all():
                row, column = np.argwhere(~np.isfinite(table))[0].tolist()
                found.append(((-(-first // topic.ticks) + row) * topic.ticks, f"{topic.path}.{topic.names[column]}"))
        return min(found, default=None)


def value_line(key: str, value: Any, unit: str) -> str:
    """What the log says of a parameter's new value."""
    return f"{key} = {value}" + ("" if unit == "1" else f" {unit}")


def _valid(key: str) -> str:
    return str(known_keys()[key]["valid"])


def _check_movable(key: str) -> tuple[float, float]:
    """Bounds of a parameter that can follow a course. Raises InputError for any other."""
    if key not in numbers():
        told = "holds for the whole run" if key in known_keys() else "is no parameter"
        if known_keys().get(key, {}).get("live"):
            told = "is no number that could move; change it"
        raise InputError(f"parameters.{key}: {told}")
    if key in STEPPED:
        raise InputError(f"parameters.{key}: more follows from it than its own value; change it instead")
    return bounds(key)


def _differences(new: Parameters, old: Parameters) -> Iterator[tuple[str, Any, Mapping[str, Any]]]:
    """Keys of ``new`` whose values are not those of ``old``, with the values and what there is to say of them."""
    for section in Parameters.model_fields:
        ours, theirs = getattr(new, section), getattr(old, section)
        if ours != theirs:
            for (key, value, about), (_, was, _) in zip(leaves(ours), leaves(theirs), strict=True):
                if value != was:
                    yield f"{section}.{key}", value, about


def _check_together(built: Mapping[str, Parameters]) -> None:
    """Raise InputError unless the axes can be stepped in one model."""
    if not built:
        raise InputError("a bench has at least one axis")
    first_name, first = next(iter(built.items()))
    for name, p in built.items():
        if not name and len(built) > 1:
            raise InputError("of several axes each has a name")
        if name and not is_axis(name):
            raise InputError(f"axis {name!r}: a name is up to 20 of a–z, 0–9 and _, a letter first")
        if p.rates != first.rates:
            raise InputError(f"axis {name!r}: parameters.rates differs from that of {first_name!r}; one clock runs all")


def _finest(built: Mapping[str, Parameters]) -> Simulation:
    """How axes in one model are stepped: as the one that needs the most steps in a tick."""
    return max((p.simulation for p in built.values()), key=lambda simulation: simulation.substeps)


def _bodies(built: Mapping[str, Parameters]) -> tick.Bodies:
    """How the drawn bodies lie and what turns them, world first."""
    found = [(0, -1, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))]
    across = mjcf.places(built)
    for a, (axis, p) in enumerate(built.items()):
        shafts = {name: f"shaft{k}" for k, name in enumerate(plant_model.shaft_names(p.gearbox.stages))}
        shafts.setdefault("motor", "shaft0")
        for body in mjcf.rest(p, axis, across[axis]):
            place = mechanism.ANGLES.index("rod_end" if body.name.endswith("rod_end") else
                                           shafts.get(body.turned_by, body.turned_by))
            found.append((a, place, body.position, body.quaternion))
    axes, angles, places, turns = zip(*found, strict=True)
    return tick.Bodies(np.array(axes), np.array(angles), np.array(places), np.array(turns))


class _Streams:
    """Random numbers of every sensor of every axis, each from a stream of its own.

    A stream follows from the seed and its own name, so another sensor, or another axis, changes none of the others.
    """

    def __init__(self, axes: Sequence[str], seed: int):
        def stream(axis: str, source: str) -> np.random.Generator:
            name = zlib.crc32(plant_model.prefixed(axis, source).encode())
            return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, name])))

        self._normal = [[stream(axis, source) for axis in axes] for source in sensors.NORMAL]
        self._woken: list[list[Any]] = [
            *([stream(axis, source).random for axis in axes] for source in sensors.UNIFORM),
            *([stream(axis, source).standard_normal for axis in axes] for source in sensors.TURBULENCE),
        ]
        self._pool = [np.zeros((0, len(axes))) for _ in sensors.NORMAL]
        self._at = 0
        self._none = np.zeros((0, len(axes)))

    def draw(self, ticks: int, chances: Sequence[Sequence[bool]]) -> sensors.Noise:
        """The random numbers of the next ``ticks`` ticks; of each source of chance for those axes that want it."""
        if self._at + ticks > len(self._pool[0]):
            new = max(_POOL, ticks)
            self._pool = [
                np.concatenate((left[self._at :], np.stack([s.standard_normal(new) for s in streams], axis=1)))
                for left, streams in zip(self._pool, self._normal, strict=True)
            ]
            self._at = 0
        normal = [pool[self._at : self._at + ticks] for pool in self._pool]
        self._at += ticks
        woken = [
            np.stack([draw(ticks) if w else np.ones(ticks) for draw, w in zip(draws, wanted, strict=True)], axis=1)
            if any(wanted) else self._none
            for draws, wanted in zip(self._woken, chances, strict=True)
        ]  # fmt: skip
        return sensors.Noise(*normal, *woken)


_POOL = 4000
"""Ticks for which noise is drawn at once."""


_listening = threading.local()
"""To whom MuJoCo's warnings go: the bench that runs in the thread. MuJoCo has one handler for all threads."""


def _hear(message: str) -> None:
    if (log := getattr(_listening, "log", None)) is not None:
        log(message)
    else:  # someone else's simulation
        warnings.warn(message, RuntimeWarning, stacklevel=2)


def versions() -> dict[str, str]:
    """Versions on which the samples depend."""
    from importlib.metadata import version

    packages = {name: version(name) for name in ("cls-bench", "mujoco", "numba", "numpy", "scipy")}
    return {**packages, "python": platform.python_version(), "jit": "on" if JIT else "off"}
