"""Parameters of what runs in the servo drive and in the PLC."""

import math
from typing import Literal

from pydantic import model_validator

from cls_bench.kinematics import FourBar
from cls_bench.parameters.bars import Levers, four_bar_of, levers_of
from cls_bench.quantity import RPM, WIDEST, Section, quantity

_FOLLOWS = "follows from the data sheets: {}"


class Nameplate(Section):
    """What drive and PLC believe of the rig. It is what data sheets say, not what the plant is.

    Each value is, by default, that of the rig as its file describes it (:mod:`cls_bench.parameters.nameplate`). What a
    scenario changes in the plant changes nothing here.
    """

    gear_ratio: float = quantity(
        ..., "1", "turns of the motor for one of the crank", _FOLLOWS.format("product of the stages' ratios"),
        ge=1e-3, le=1e6,
    )  # fmt: skip
    linkage: Literal["four_bar", "none"] = quantity(
        "four_bar", "1", "whether a linkage or a shaft drives the column", _FOLLOWS.format("linkage.kind")
    )
    crank: float = quantity(..., "m", "crank", _FOLLOWS.format("linkage.crank"), ge=0.01, le=2)
    rod: float = quantity(..., "m", "connecting rod", _FOLLOWS.format("linkage.rod"), ge=0.01, le=5)
    arm: float = quantity(..., "m", "column axis to rod joint", _FOLLOWS.format("linkage.arm"), ge=0.01, le=2)
    crank_angle: float = quantity(
        ..., "rad", "crank at neutral", _FOLLOWS.format("linkage.crank_angle"), ge=-math.pi, le=math.pi
    )
    rod_angle: float = quantity(
        ..., "rad", "rod at neutral", _FOLLOWS.format("linkage.rod_angle"), ge=-math.pi, le=math.pi
    )
    arm_angle: float = quantity(
        ..., "rad", "column arm at neutral", _FOLLOWS.format("linkage.arm_angle"), ge=-math.pi, le=math.pi
    )
    torque_constant: float = quantity(
        ..., "N·m/A", "torque constant", _FOLLOWS.format("motor.torque_constant"), ge=1e-3, le=100
    )
    resistance: float = quantity(
        ..., "Ω", "equivalent resistance", _FOLLOWS.format("motor.resistance"), ge=1e-3, le=1e4
    )
    inductance: float = quantity(
        ..., "H", "equivalent inductance", _FOLLOWS.format("motor.inductance"), ge=1e-6, le=10
    )
    thermal_time_constant: float = quantity(
        ..., "s", "time constant of the I²t monitor", _FOLLOWS.format("motor.thermal_time_constant"), ge=0.1, le=1e5
    )
    load_inertia: float = quantity(
        ..., "kg·m²", "total inertia at the motor shaft at neutral, for which the gains are designed",
        "thesis table 3.3: 4.00e-5 + 5.27e-5; of other rigs it follows from the data sheets",
        ge=1e-8, le=100, live=True,
    )  # fmt: skip
    unbalance: float = quantity(
        ..., "N·m/rad", "static unbalance that is taken out of the measured torque, over the column's angle",
        _FOLLOWS.format("weight of column and rod, the line that fits it best over the travel (thesis figure 3.37)"),
        ge=-1e4, le=1e4,
    )  # fmt: skip
    load_cell_gain: float = quantity(
        ..., "N", "force of one converter count",
        _FOLLOWS.format("load_cell.capacity, to both sides, over 2^adc_bits"), ge=1e-12, le=1e3,
    )  # fmt: skip
    stop_angle: float = quantity(
        ..., "rad", "where set angles end (software limit)", _FOLLOWS.format("column.stop_angle"),
        ge=0.01, lt=WIDEST,
    )  # fmt: skip
    reach: float = quantity(
        ..., "rad", "angle to either side over which polynomials stand for the linkage",
        _FOLLOWS.format("3° beyond the limit switches, at least to the stops"), ge=0.01, lt=WIDEST + 0.1,
    )  # fmt: skip

    @property
    def levers(self) -> Levers:
        """Levers at neutral."""
        return levers_of(self.linkage, self)

    @property
    def four_bar(self) -> FourBar:
        """Lengths and angles for :mod:`cls_bench.kinematics`."""
        return four_bar_of(self.linkage, self)


class Drive(Section):
    """B&R ACOPOS servo drive: power stage, limits and cascade (thesis 3.6.1)."""

    dc_bus_voltage: float = quantity(
        325.0, "V", "DC bus", "thesis table 3.2: 230 V mains, rectified (√2)",
        ge=1, le=1000,
    )
    modulation: float = quantity(
        0.883, "1", "usable part of the linear range of space-vector modulation",
        "assumed: with it the no-load speed is the data sheet's 11 400 rpm",
        ge=0.01, le=1,
    )  # fmt: skip
    peak_current: float = quantity(20.38, "A", "current limit", "thesis table 3.2", ge=0.01, le=1e4, live=True)
    continuous_current: float = quantity(
        3.397, "A", "current that the I²t monitor allows for good", "thesis table 3.2: 1.00 N·m at stall",
        ge=0.01, le=1e4, live=True,
    )  # fmt: skip
    torque_limit: float = quantity(6.0, "N·m", "torque limit", "thesis table 3.2", ge=1e-3, le=1e4, live=True)
    speed_limit: float = quantity(11400.0 * RPM, "rad/s", "speed limit", "thesis table 3.2", ge=0.1, le=1e4, live=True)
    current_bandwidth: float = quantity(
        1000.0, "Hz", "bandwidth of the current controller", "assumed: usual at a 50 µs cycle",
        ge=0.1, le=1e4, live=True,
    )
    velocity_bandwidth: float = quantity(
        100.0, "Hz", "bandwidth of the velocity controller",
        "assumed: tuned, with the two below, so that a squeezed grip is stable at I_fcs 0.30 and not at 0.25 "
        "(thesis 4.4)",
        ge=0.01, le=1e4, live=True,
    )  # fmt: skip
    velocity_integral_time: float = quantity(
        0.02, "s", "integral time T_n of the velocity controller", "assumed: tuned",
        ge=1e-4, le=1e6, live=True,
    )
    position_bandwidth: float = quantity(
        35.0, "Hz", "bandwidth of the position controller", "assumed: tuned",
        ge=0.01, le=1e4, live=True,
    )
    position_integral_time: float = quantity(
        0.0, "s", "integral time of the position controller; 0 switches the integral off",
        "thesis 3.6.1 names a PI; off by default because the velocity controller already integrates",
        ge=0, le=1e6, live=True,
    )  # fmt: skip
    speed_filter_time: float = quantity(
        0.0004, "s", "time constant of the speed filter", "assumed: two velocity cycles",
        ge=0, le=10, live=True,
    )
    voltage_latency: int = quantity(
        1, "ticks", "ticks of rates.current_cycle from the current sample to the voltage it leads to",
        "assumed: computed in one period, put out in the next", ge=0, le=16,
    )  # fmt: skip
    set_torque: float = quantity(0.0, "N·m", "torque asked for in torque mode", "chosen", ge=-1e4, le=1e4, live=True)
    feed_forward_velocity: bool = quantity(
        False, "1", "feed the set velocity forward to the velocity controller",
        "thesis 3.6.1: a further option; with it the outer loop is stable down to I_fcs 0.11", live=True,
    )
    feed_forward_inertia: bool = quantity(
        False, "1", "feed nameplate.load_inertia × set acceleration forward to the current controller", "thesis 3.6.1",
        live=True,
    )
    feed_forward_pilot: bool = quantity(
        False, "1", "feed the measured pilot torque forward to the current controller", "thesis 3.6.1", live=True
    )

    @model_validator(mode="after")
    def _integral(self) -> "Drive":
        if 0.0 < self.position_integral_time < 1e-4:
            raise ValueError("position_integral_time: give 0, which switches the integral off, or at least 0.0001 s")
        return self

    @property
    def voltage_limit(self) -> float:
        """Largest equivalent motor voltage [V]: √(3/2) · modulation · DC bus."""
        return math.sqrt(1.5) * self.modulation * self.dc_bus_voltage


class Plc(Section):
    """Outer loop in the PLC, and the field bus (Powerlink): a task each PLC cycle, frames each bus cycle."""

    outer_loop: Literal["position", "velocity"] = quantity(
        "position", "1", "what the outer loop asks of the drive", "thesis 2.5.3, 3.6; velocity: Eq. 3.8"
    )
    command_latency: int = quantity(
        1, "cycles", "field-bus cycles from the PLC's result to the drive", "Powerlink: sent in the following cycle",
        ge=0, le=16,
    )  # fmt: skip
    feedback_latency: int = quantity(
        1, "cycles", "field-bus cycles from the drive's encoder to the PLC", "Powerlink: sent in the following cycle",
        ge=0, le=16,
    )  # fmt: skip
    frame_loss: float = quantity(
        0.0, "1", "share of field-bus frames that are lost; the receiver keeps what it has", "chosen: none",
        ge=0, le=1, live=True,
    )  # fmt: skip
    units_per_revolution: float = quantity(
        3600.0, "1/rev", "PLCopen units in a motor revolution", "thesis table 3.5",
        ge=1, le=1e9,
    )
    polynomial_degree: int = quantity(
        9, "1", "degree of the polynomials that stand for the linkage's kinematics",
        "chosen: the least odd degree under 1e-5 rad over the travel", ge=1, le=15,
    )  # fmt: skip
    remove_unbalance: bool = quantity(
        True, "1", "take the static unbalance out of the measured torque", "thesis 3.6.2, T_stat", live=True
    )
    following_error_limit: float = quantity(
        0.2, "rad", "column angle between set and actual position at which the drive is switched off",
        "thesis 3.6.3 proposes it; value assumed: half the travel to one side",
        ge=1e-4, le=10, live=True,
    )  # fmt: skip
