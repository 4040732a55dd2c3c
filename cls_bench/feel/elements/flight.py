"""Flight condition: what the host computer tells the feel model of the flight (thesis 3.5.2)."""

from cls_bench.feel.element import Element
from cls_bench.quantity import quantity


class Flight(Element):
    """What surface, q-feel, bob-weight, unbalance and gusts depend on; it has no torque of its own."""

    dynamic_pressure: float = quantity(
        0.0, "Pa", "½ρv²", "given by the flight; 0 on the ground", ge=0, le=2e5, live=True
    )
    airspeed: float = quantity(0.0, "m/s", "true airspeed", "given by the flight; 0 on the ground", ge=0, le=1e3,
                               live=True)  # fmt: skip
    angle_of_attack: float = quantity(
        0.0, "rad", "α, of the rudder the sideslip β", "given by the flight", ge=-1.6, le=1.6, live=True
    )
    load_factor: float = quantity(1.0, "1", "n_z", "1 in level flight", ge=-10, le=20, live=True)
    tab: float = quantity(0.0, "rad", "deflection δ_t of the trim tab", "given by the flight", ge=-1.0, le=1.0,
                          live=True)  # fmt: skip
