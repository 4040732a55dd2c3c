"""Every parameter of the bench, in sections: the plant's, those of drive and PLC, the feel model's, the rates.

:data:`PLANT` and :data:`CONTROL` say which of them either side may read. Control reads its nameplate, never the plant.
"""

from typing import Any

import numpy as np
from pydantic import model_validator

from cls_bench.feel.elements.travel_limit import TravelLimit
from cls_bench.feel.model import Feel
from cls_bench.kinematics import FourBar, crank_from_column, crank_ratio, fit_polynomials, polynomial
from cls_bench.parameters.control import Drive, Nameplate, Plc
from cls_bench.parameters.nameplate import nameplate_of
from cls_bench.parameters.plant import (
    Column,
    Encoder,
    Gearbox,
    GearStage,
    Limb,
    Linkage,
    LoadCell,
    Motor,
    Potentiometer,
    mesh_efficiency,
)
from cls_bench.parameters.rates import Rates, Simulation
from cls_bench.parameters.record import kind_of, memory_of, record_of
from cls_bench.quantity import ARCMIN, DEG, GRAVITY, RPM, Section, leaves
from cls_bench.signals import MOST_STAGES

__all__ = [
    "ARCMIN", "CONTROL", "DEG", "GRAVITY", "MOST_STAGES", "PLANT", "RPM", "Column", "ControlParameters", "Drive",
    "Encoder", "Feel", "GearStage", "Gearbox", "Limb", "Linkage", "LoadCell", "Motor", "Nameplate", "Parameters",
    "Plc", "Potentiometer", "Rates", "Section", "Simulation", "TravelLimit", "kind_of", "leaves", "memory_of",
    "mesh_efficiency", "nameplate_of", "record_of",
]  # fmt: skip

PLANT = ("motor", "gearbox", "linkage", "load_cell", "column", "limb", "encoder", "potentiometer")
"""Sections that describe what there is."""

CONTROL = ("nameplate", "drive", "plc", "feel")
"""Sections that drive and PLC read."""

_THESIS_INERTIA = 9.27e-5
"""Total inertia at the motor shaft [kg·m²], thesis table 3.3; the rule gives 9.275e-5."""

FLATTEST, STEEPEST = 0.05, 20.0
"""Least and greatest linkage ratio that a bench can be built with."""


class ControlParameters(Section):
    """What a controller may know: nameplate, drive, PLC, feel model and cycles; nothing of the plant's true values."""

    nameplate: Nameplate
    drive: Drive
    plc: Plc
    feel: Feel
    rates: Rates


class Parameters(Section):
    """All parameters of the bench."""

    motor: Motor = Motor()
    gearbox: Gearbox = Gearbox()
    linkage: Linkage = Linkage()
    load_cell: LoadCell = LoadCell()
    column: Column = Column()
    limb: Limb = Limb()
    encoder: Encoder = Encoder()
    potentiometer: Potentiometer = Potentiometer()
    nameplate: Nameplate = nameplate_of(
        Motor(), Gearbox(), Linkage(), LoadCell(), Column(), load_inertia=_THESIS_INERTIA
    )
    drive: Drive = Drive()
    plc: Plc = Plc()
    feel: Feel = Feel()
    rates: Rates = Rates()
    simulation: Simulation = Simulation()

    def with_nameplate(self) -> "Parameters":
        """The same with the nameplate that these data sheets give: what a rig is delivered with."""
        plate = nameplate_of(self.motor, self.gearbox, self.linkage, self.load_cell, self.column)
        return self.model_copy(update={"nameplate": plate})

    @property
    def for_control(self) -> ControlParameters:
        """What a controller may know of these."""
        return ControlParameters.model_construct(**{name: getattr(self, name) for name in (*CONTROL, "rates")})

    @model_validator(mode="after")
    def _sampled(self) -> "Parameters":
        """No controller is asked for more than half the rate at which it is worked out."""
        for name in ("current", "velocity", "position"):
            bandwidth, cycle = getattr(self.drive, f"{name}_bandwidth"), getattr(self.rates, f"{name}_cycle")
            if bandwidth > 0.5 / cycle * (1.0 + 1e-9):
                raise ValueError(
                    f"drive.{name}_bandwidth = {bandwidth:g} Hz is more than half the rate of that controller; with "
                    f"rates.{name}_cycle = {cycle:g} s it must be at most {0.5 / cycle:g} Hz"
                )
        return self

    @model_validator(mode="after")
    def _linkage(self) -> "Parameters":
        """The linkage moves over the whole range, far from its dead points, and the PLC's polynomials follow theirs."""
        plate, degree = self.nameplate, self.plc.polynomial_degree
        _check_linkage("linkage: crank, rod and arm", self.linkage.four_bar, self.column.reach)
        _check_linkage("nameplate: crank, rod and arm", plate.four_bar, plate.reach)
        if plate.four_bar.rod > 0.0 and (plate.four_bar, plate.reach, degree) != _SHIPPED:
            bar, reach = plate.four_bar, plate.reach
            polynomials = fit_polynomials(bar, reach, degree)
            for column in np.linspace(-reach, reach, 41):
                crank = crank_from_column(bar, column)
                ratio = crank_ratio(bar, crank, column)
                fitted = polynomial(polynomials.ratio, column), 1.0 / polynomial(polynomials.inverse_ratio, crank)
                if not all(0.5 * ratio <= value <= 2.0 * ratio for value in fitted):
                    raise ValueError(
                        f"polynomials of degree {degree} do not follow the linkage over ±{reach / DEG:.3g}°; give "
                        "another plc.polynomial_degree"
                    )
        return self


def _check_linkage(what: str, bar: FourBar, reach: float) -> None:
    """Raise ValueError unless the linkage closes and stays clear of its dead points over ±``reach`` [rad]."""
    if bar.rod == 0.0 or (bar, reach) == _SHIPPED[:2]:
        return  # the shipped one without compiling the kinematics
    over = f"over ±{reach / DEG:.3g}°"
    for column in np.linspace(-reach, reach, 41):
        crank = crank_from_column(bar, column)
        if not np.isfinite(crank):
            raise ValueError(f"{what}: the linkage cannot be closed {over}")
        ratio = crank_ratio(bar, crank, column)
        if not FLATTEST <= ratio <= STEEPEST:
            raise ValueError(
                f"{what}: the linkage comes near a dead point {over}; dφc/dφ must stay from "
                f"{FLATTEST:g} to {STEEPEST:g}, and is {ratio:.3g} at {column / DEG:.3g}°"
            )


_SHIPPED: tuple[Any, ...] = (Linkage().four_bar, Column().reach, Plc().polynomial_degree)
