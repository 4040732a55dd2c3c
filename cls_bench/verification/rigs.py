"""The rigs that the plant is verified with: one for each thing that a rig can have."""

from functools import cache

from cls_bench.parameters import ARCMIN, DEG, Column, Gearbox, GearStage, Limb, Linkage, Motor, Parameters

SERVO = Motor(rotor_inertia=1.6e-4, torque_constant=0.9, resistance=3.0, inductance=6e-3)
"""A servo of 4 N·m."""

TORQUE_MOTOR = Motor(
    rotor_inertia=8e-3, torque_constant=6.0, resistance=2.5, inductance=25e-3, thermal_resistance=0.7,
    cogging_amplitude=0.3, cogging_periods=66,
)  # fmt: skip
"""A torque motor that needs no gear."""

ONE = GearStage(
    ratio=10.0, teeth=18, stiffness=5.0 / ARCMIN, backlash=4.0 * ARCMIN, drag=0.12, transmission_error=0.3 * ARCMIN,
    inertia=2.5e-4, efficiency=0.96, backdrive_efficiency=0.93,
)  # fmt: skip

BELT = GearStage(
    kind="belt", ratio=5.0, teeth=0, stiffness=2500.0, damping_ratio=0.08, drag=0.03, inertia=6e-4, efficiency=0.98,
    backdrive_efficiency=0.98, ripple=0.0,
)  # fmt: skip

SPUR = GearStage(
    kind="spur", ratio=4.0, teeth=17, stiffness=3.0 / ARCMIN, backlash=6.0 * ARCMIN, drag=0.04,
    transmission_error=0.3 * ARCMIN, inertia=3e-4, efficiency=0.98, backdrive_efficiency=0.97,
)  # fmt: skip

WORM = GearStage(
    kind="worm", ratio=20.0, teeth=2, stiffness=4.0 / ARCMIN, backlash=3.0 * ARCMIN, drag=0.08,
    transmission_error=0.2 * ARCMIN, inertia=4e-4, efficiency=0.7, backdrive_efficiency=-0.2, ripple=0.1,
)  # fmt: skip

TILTED = Linkage(crank=0.09, rod=0.26, arm=0.14, crank_angle=25.0 * DEG, rod_angle=15.0 * DEG, arm_angle=-12.0 * DEG)
"""A four-bar that stands upright nowhere."""

BELOW = Linkage(crank=0.12, rod=0.30, arm=0.15, crank_angle=170.0 * DEG, rod_angle=-8.0 * DEG, arm_angle=175.0 * DEG)
"""A four-bar whose rod lies below both axes."""


def _rig(**sections: object) -> Parameters:
    return Parameters(**sections).with_nameplate()  # type: ignore[arg-type]


@cache
def rigs() -> dict[str, Parameters]:
    """The rigs by name."""
    one = Gearbox(stages=1, stage1=ONE)
    seal = Gearbox(stages=1, stage1=ONE.model_copy(update={"drag_ratio": 2.0}))
    return {
        "thesis": Parameters(),
        "one stage": _rig(motor=SERVO, gearbox=seal),
        "three stages": _rig(
            gearbox=Gearbox(
                stages=3,
                stage1=SPUR.model_copy(update={"ratio": 2.0, "inertia": 1.2e-4}),
                stage2=GearStage(
                    ratio=3.0,
                    stiffness=2.0 / ARCMIN,
                    backlash=4.0 * ARCMIN,
                    drag=0.04,
                    inertia=1.5e-4,
                    efficiency=0.97,
                    backdrive_efficiency=0.95,
                    transmission_error=0.3 * ARCMIN,
                ),
                stage3=GearStage(
                    ratio=4.0,
                    stiffness=6.0 / ARCMIN,
                    backlash=3.0 * ARCMIN,
                    drag=0.1,
                    inertia=3e-4,
                    efficiency=0.96,
                    backdrive_efficiency=0.93,
                    transmission_error=0.2 * ARCMIN,
                ),
            )
        ),
        "belt": _rig(motor=SERVO, gearbox=Gearbox(stages=2, stage1=BELT, stage2=ONE.model_copy(update={"ratio": 4.0}))),
        "worm": _rig(gearbox=Gearbox(stages=1, stage1=WORM)),
        "direct drive": _rig(motor=TORQUE_MOTOR, gearbox=Gearbox(stages=0, input_inertia=0.0)),
        "motor on the column": _rig(
            motor=TORQUE_MOTOR, gearbox=Gearbox(stages=0, input_inertia=0.0), linkage=Linkage(kind="none")
        ),
        "tilted four-bar": _rig(motor=SERVO, gearbox=one, linkage=TILTED),
        "rod below": _rig(
            motor=SERVO, gearbox=one, linkage=BELOW, column=Column(grip_height=0.45, inertia=0.08), limb=Limb(mass=2.2)
        ),
    }
