"""All that drive and PLC know: their parameters, what follows from them, and what they remember."""

from typing import Any

import numpy as np

from cls_bench.control import latch, plc, servo
from cls_bench.control.tuning import GAINS, design
from cls_bench.feel.element import PIECE
from cls_bench.feel.model import STATE as FEEL
from cls_bench.kinematics import fit_polynomials
from cls_bench.parameters import CONTROL, ControlParameters, kind_of

COEFFICIENTS = 16
"""Places for the coefficients of a polynomial: degree 15 at most."""

POLYNOMIALS = ("crank", "ratio", "curvature", "rod", "column", "inverse_ratio")
"""Of :class:`cls_bench.kinematics.Polynomials`, those that the PLC uses."""

DESIGN = np.dtype(
    [
        ("gains", GAINS),
        ("polynomials", [(name, np.float64, (COEFFICIENTS,)) for name in POLYNOMIALS]),
        ("shaft", np.int64),  # whether there is no linkage
        ("units_per_radian", np.float64),  # PLCopen units in a radian of the motor shaft
        ("voltage_limit", np.float64),  # [V]
        ("tick", np.float64), ("velocity_cycle", np.float64),  # [s]
        ("position_cycle", np.float64), ("plc_cycle", np.float64),  # [s]
    ]
)  # fmt: skip
"""What follows from the parameters."""

STATE = np.dtype(
    [
        ("plc", plc.STATE),
        ("feel", FEEL),
        ("servo", servo.STATE),
        # commands: field bus, PLC → drive; feedback: drive → PLC; voltages: current controller → power stage
        *((name, np.float64, (latch.DEPTH, len(slots))) for name, slots in plc.SLOTS.items()),
        ("power", np.int64),  # whether the drive is switched on
        ("external", np.int64),  # whether a user's outer loop gives the set values
        ("trip_tick", np.int64),  # when the PLC last switched the drive off
        ("invalid", np.int64),  # what it found then, for INVALID_VALUE: place of a number
    ]
)
"""What drive and PLC remember."""

_SECTIONS: dict[str, Any] = {name: info.annotation for name, info in ControlParameters.model_fields.items()}

CONTROLLER = np.dtype(
    [
        ("parameters", [(name, kind_of(_SECTIONS[name])) for name in CONTROL]),
        ("design", DESIGN),
        ("state", STATE),
        ("piece", PIECE),  # working memory of the feel model
    ]
)
"""Drive and PLC of one axis."""


def configure(design_record: Any, control: Any, p: ControlParameters) -> None:
    """Put what follows from ``p`` into the record ``design_record``.

    ``control`` is the same as a record. Raises ValueError if the linkage of the nameplate cannot be closed.
    """
    clock, plate = p.rates.clock, p.nameplate
    gains = design(control.drive, control.nameplate, clock.velocity_s)
    for name, value in gains._asdict().items():
        design_record.gains[name] = value
    fitted = fit_polynomials(plate.four_bar, plate.reach, p.plc.polynomial_degree)
    for name in POLYNOMIALS:
        coefficients = getattr(fitted, name)
        row = design_record.polynomials[name]
        row[:] = 0.0
        row[: len(coefficients)] = coefficients
    design_record.shaft = int(plate.linkage == "none")
    design_record.units_per_radian = p.plc.units_per_revolution / (2.0 * np.pi)
    design_record.voltage_limit = p.drive.voltage_limit
    design_record.tick, design_record.velocity_cycle = clock.tick_s, clock.velocity_s
    design_record.position_cycle, design_record.plc_cycle = clock.position_s, clock.plc_s
