"""The nameplate that a rig is delivered with: what follows for drive and PLC from the data sheets of its parts."""

import math

from cls_bench.parameters.control import Nameplate
from cls_bench.parameters.plant import Column, Gearbox, Linkage, LoadCell, Motor
from cls_bench.quantity import GRAVITY


def nameplate_of(
    motor: Motor, gearbox: Gearbox, linkage: Linkage, load_cell: LoadCell, column: Column, **known: float
) -> Nameplate:
    """The nameplate for these data sheets; ``known`` are values that a data sheet states itself."""
    values = {
        "gear_ratio": gearbox.ratio,
        "linkage": linkage.kind,
        **{name: getattr(linkage, name) for name in ("crank", "rod", "arm", "crank_angle", "rod_angle", "arm_angle")},
        "torque_constant": motor.torque_constant,
        "resistance": motor.resistance,
        "inductance": motor.inductance,
        "thermal_time_constant": motor.thermal_time_constant,
        "load_inertia": inertia_at_motor(motor, gearbox, linkage, column),
        "unbalance": static_unbalance(column, linkage),
        "load_cell_gain": load_cell.count,
        "stop_angle": column.stop_angle,
        "reach": column.reach,
    }
    return Nameplate(**{**values, **known})


def inertia_at_motor(motor: Motor, gearbox: Gearbox, linkage: Linkage, column: Column) -> float:
    """Inertia of all that moves, at the motor shaft at neutral, as thesis table 3.3 adds it up [kg·m²]."""
    ratio = linkage.levers.ratio
    at_crank, far, end = linkage.masses
    crank = linkage.crank_inertia + at_crank * linkage.crank**2
    behind = (column.inertia + (far + end) * linkage.arm**2) / ratio**2
    return motor.rotor_inertia + gearbox.inertia_at_motor + (crank + behind) / gearbox.ratio**2


def static_unbalance(column: Column, linkage: Linkage) -> float:
    """Slope U [N·m/rad] of the unbalance torque U φ: linear fit of (Σ m g h) sin φ over the travel (thesis fig. 3.37).

    The rod's share at the column joint hangs on the column, across the rod, where the load cell does not see it. Of an
    arm that does not stand upright at neutral the part that its weight exerts there already is left to the zero of the
    load cell.
    """
    _, far, end = linkage.masses
    lever, tilt = linkage.levers, linkage.rod_angle
    of_arm, of_crank = linkage.arm_angle - tilt, linkage.crank_angle - tilt
    turn = (linkage.arm * math.sin(of_arm) - lever.ratio * linkage.crank * math.sin(of_crank)) / linkage.rod  # dρ/dφ
    # Slope of cos ρ · sin(α + φ − ρ): what of the far share's weight is across the rod, at the arm's lever.
    across = math.cos(tilt) * math.cos(of_arm) * (1.0 - turn) - math.sin(tilt) * math.sin(of_arm) * turn
    rod = (far * across + end * math.cos(linkage.arm_angle)) * linkage.arm
    peak = GRAVITY * (column.mass * column.mass_height + rod)
    # Least squares of sin φ by a line through the origin: ∫ φ sin φ / ∫ φ² over the travel a.
    a = column.travel
    return peak * 3.0 * (math.sin(a) - a * math.cos(a)) / a**3
