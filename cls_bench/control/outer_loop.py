"""The port of the outer loop: what a user's own one sees of the rig and answers, and how the compiled loop asks it.

It sees what the real PLC could know, and its answer goes where the built-in feel model's goes. Records are read and
written by name.
"""

import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from cls_bench.compiled import Callback
from cls_bench.errors import ControllerError, one_line


class Inputs(NamedTuple):
    """What a user's outer loop is given in every PLC cycle: measurements, never the plant's state."""

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
        """Called in every PLC cycle while the drive is on."""
        ...


class _Port(NamedTuple):
    """The outer loop of an axis and the fields that it reads and writes, each a view of one number."""

    loop: OuterLoop | None
    # of the PLC's state, measured
    torque: Any
    force: Any
    angle: Any
    velocity: Any
    # of the PLC's state, asked for
    set_angle: Any
    set_velocity: Any
    set_acceleration: Any
    set_torque: Any
    # of the feel model's state, which stands for whatever gives the set values
    model_angle: Any
    model_velocity: Any
    model_torque: Any

    @classmethod
    def of(cls, loop: OuterLoop | None, state: Any) -> "_Port":
        """Between ``loop`` and ``state``, an array of the one record of what drive and PLC of the axis remember."""
        plc, feel = state["plc"], state["feel"]

        def field(name: str) -> Any:  # a memory view gives a plain float, several times as fast as an array
            model = name.startswith("model_")
            return memoryview(feel[name.removeprefix("model_")] if model else plc[name])

        return cls(loop, *map(field, cls._fields[1:]))


class Asking:
    """Asks users' outer loops from within the compiled loop.

    ``loops`` are those of all axes, None where there is none, ``states`` what their drives and PLCs remember, an array
    of one record each. ``failed`` makes the error of what a user's code raised, from what is to be said before it.
    """

    alive: ClassVar["weakref.WeakSet[Asking]"] = weakref.WeakSet()
    """All there are, for whoever watches that the user's code comes back."""

    def __init__(
        self, loops: Sequence[OuterLoop | None], states: Sequence[Any], tick_s: float,
        failed: Callable[[str, BaseException], BaseException],
    ):  # fmt: skip
        self.failure: BaseException | None = None
        """why the loop was stopped"""
        self.asked = self.answered = -1
        """tick of the last question and of the last answer"""
        self.ask = Callback(self._ask)
        self._tick_s, self._failed = tick_s, failed
        self._ports = [_Port.of(loop, state) for loop, state in zip(loops, states, strict=True)]
        if any(loop is not None for loop in loops):
            self.alive.add(self)

    def _ask(self, number: int) -> int:
        at, axis = divmod(number, len(self._ports))
        port = self._ports[axis]
        inputs = Inputs(at * self._tick_s, port.torque[0], port.force[0], port.angle[0], port.velocity[0])
        self.asked = at
        try:
            command = self._answer(port.loop, inputs)
        except BaseException as error:  # none may pass through the compiled loop, not even Ctrl-C
            self.failure = error
            return 1
        finally:
            self.answered = at
        port.set_angle[0], port.set_velocity[0], port.set_acceleration[0], port.set_torque[0] = command
        port.model_angle[0], port.model_velocity[0], port.model_torque[0] = *command[:2], inputs.torque
        return 0

    def _answer(self, loop: Any, inputs: Inputs) -> Command:
        """The user's command; ControllerError of one line if there is none that can be used, whatever was raised."""
        try:
            answer = loop.step(inputs)
            command = _command(answer)
        except BaseException as error:
            what = f"{type(loop).__name__}.step failed at t = {inputs.time:.4f} s"
            raise self._failed(what, error) from error
        if command is None:
            try:
                shown = one_line(repr(answer))
            except BaseException:  # whatever a user's __repr__ may raise
                shown = f"a {type(answer).__name__}"
            raise ControllerError(
                f"{type(loop).__name__}.step returned {shown} at t = {inputs.time:.4f} s; "
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
