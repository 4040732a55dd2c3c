"""An axis: one control with its drive, as a value. What it is made of, and what it remembers while it runs.

The record :data:`AXIS` has two sides that meet in the tick alone: ``truth``, the plant, and ``controller``, drive and
PLC, which know their nameplate and the ``samples`` and nothing of the truth.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cls_bench.control import limits, plc, servo, validity
from cls_bench.control.state import CONTROLLER, configure
from cls_bench.errors import InputError
from cls_bench.parameters import CONTROL, PLANT, Parameters
from cls_bench.parameters.moving import STEPPED
from cls_bench.parameters.record import values_of
from cls_bench.plant import mechanism, sensors
from cls_bench.plant.state import TRUTH

AXIS = np.dtype(
    [
        ("truth", TRUTH),
        ("samples", sensors.SAMPLES),
        ("controller", CONTROLLER),
        ("limits", limits.STATE),
    ]
)

SLOTS = {**plc.SLOTS, **limits.SLOTS}
"""Names of the columns of its tables."""

NUMBERS = (
    validity.places(AXIS, ("controller.parameters.",), SLOTS),
    validity.places(AXIS, ("controller.state.", "samples."), SLOTS),
)
"""Names and places of the numbers that the controller's self-check looks at: its parameters, what it remembers."""

_OWNERS = tuple(f"{owner}.parameters." for owner in ("truth", "controller"))

WORDS: Mapping[str, int] = {
    name.removeprefix(owner): word
    for name, word, kind in validity.numbers(AXIS, SLOTS) for owner in _OWNERS
    if name.startswith(owner) and kind == np.float64 and name.removeprefix(owner) not in STEPPED
}  # fmt: skip
"""Where a parameter stands in the record, in 8-byte words, of those numbers that act from there alone."""


def set_parameters(axis: Any, p: Parameters) -> None:
    """Put ``p``, and all that follows from it, into the record ``axis``; what it remembers stays. Raises InputError."""
    for name in PLANT:
        axis.truth.parameters[name] = values_of(getattr(p, name))
    mechanism.configure(axis.truth.mechanism, p)
    for name in CONTROL:
        axis.controller.parameters[name] = values_of(getattr(p, name))
    try:
        configure(axis.controller.design, axis.controller.parameters, p.for_control)
    except ValueError as error:
        raise InputError(f"parameters.nameplate: {error}") from None


def forget(axis: Any, p: Parameters) -> None:
    """Let the record ``axis`` remember nothing, as before it was first switched on."""
    axis.truth.body = np.zeros((), axis.truth.body.dtype)
    axis.truth.shown = np.zeros((), axis.truth.shown.dtype)
    axis.samples = np.zeros((), axis.samples.dtype)
    axis.controller.state = np.zeros((), axis.controller.state.dtype)
    axis.limits = np.zeros((), axis.limits.dtype)
    axis.controller.state.servo.mode = servo.VELOCITY if p.plc.outer_loop == "velocity" else servo.POSITION
