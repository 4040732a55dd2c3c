"""Parameters of the feel model: the flight control system that the pilot is to feel."""

from pydantic import model_validator

from cls_bench.parameters.quantity import DEG, WIDEST, Section, part, quantity


class TravelLimit(Section):
    """A virtual stop: additional stiffness and damping beyond an angle (thesis 3.5.2)."""

    angle: float = quantity(0.0, "rad", "where it begins, to either side", "", ge=1e-3, lt=WIDEST, live=True)
    stiffness: float = quantity(0.0, "N·m/rad", "additional stiffness c_hs", "", ge=0, le=1e6, live=True)
    damping: float = quantity(0.0, "N·m·s/rad", "additional damping d_hs", "", ge=0, le=1e5, live=True)


class Feel(Section):
    """Single-body model of the flight control system at the column's axis (thesis 3.5.2)."""

    inertia: float = quantity(0.3, "kg·m²", "I_fcs", "thesis figure 4.2", ge=1e-3, le=100, live=True)
    damping: float = quantity(1.5, "N·m·s/rad", "d_fcs", "thesis figure 4.2", ge=0, le=1e4, live=True)
    stiffness: float = quantity(35.0, "N·m/rad", "c_fcs", "thesis figure 4.2", ge=0, le=1e5, live=True)
    friction: float = quantity(
        0.25, "N·m", "Coulomb friction μ_fcs, with stiction", "thesis figure 4.2",
        ge=0, le=1e3, live=True,
    )
    neutral: float = quantity(
        0.0, "rad", "neutral position φ_0 (trim)", "thesis 3.5.2", gt=-WIDEST, lt=WIDEST, live=True
    )
    aft_limit: TravelLimit = part(
        TravelLimit(angle=14.0 * DEG, stiffness=150.0, damping=2.0),
        "travel limit of the control surface, softened by the cables",
        angle="assumed: within the travel of ±20°, so that both limits of thesis figure 4.2 are reached",
        stiffness="assumed: four times c_fcs, so that the torque bends visibly, as in thesis figure 4.2",
        damping="assumed: a little more than the model's own",
    )
    forward_limit: TravelLimit = part(
        TravelLimit(angle=17.0 * DEG, stiffness=1500.0, damping=15.0),
        "travel limit of the column itself, stiff",
        angle="assumed: 3° beyond the surface's, before the limit switches",
        stiffness="assumed: ten times the cables': thesis 4.2 calls it the stiff one",
        damping="assumed: a third of critical for the model's inertia",
    )
    centering_stiffness: float = quantity(
        0.0, "N·m/rad", "slope of the centering unit about neutral", "thesis 3.5.2",
        ge=0, le=1e5, live=True,
    )
    centering_breakout: float = quantity(
        0.0, "N·m", "torque at which the centering unit saturates", "thesis 3.5.2",
        ge=0, le=1e3, live=True,
    )
    autopilot_torque: float = quantity(0.0, "N·m", "T_ap", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    disturbance_torque: float = quantity(0.0, "N·m", "T_dis", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    shaker_torque: float = quantity(
        0.0, "N·m", "amplitude of the stick shaker T_sw", "thesis 3.5.2",
        ge=0, le=1e3, live=True,
    )  # fmt: skip
    shaker_frequency: float = quantity(
        20.0, "Hz", "frequency of the stick shaker", "assumed: usual for stick shakers",
        ge=0.1, lt=1000, live=True,
    )

    @model_validator(mode="after")
    def _limits(self) -> "Feel":
        if not self.aft_limit.angle <= self.forward_limit.angle:
            raise ValueError("aft_limit.angle must not exceed forward_limit.angle")
        return self
