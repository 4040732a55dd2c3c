from collections.abc import Callable

import numpy as np
import pytest

from cls_bench.bench import Bench, DivergedError
from cls_bench.errors import InputError
from cls_bench.linear.hand import Hand
from cls_bench.linear.variation import changed
from cls_bench.parameters import Gearbox, Linkage, Parameters, Rates
from cls_bench.pilot import constant, sine
from cls_bench.scenario import parse_scenario
from cls_bench.stability.driving import Part, Script, run
from cls_bench.step_limit import check_step, unstable_parameter

HEADER = """
title = "step limit"
duration = 1.0
[[hand]]
at = 0.0
kind = "hold"
"""


def with_parameters(values: dict[str, object], substeps: int = 1) -> Parameters:
    p = changed(Parameters(), "simulation.substeps", substeps)
    for key, value in values.items():
        p = changed(p, key, value)
    return p


def shaken(p: Parameters, squeeze: float | None = 1.0) -> str:
    """The hand shakes the control from stop to stop, the drive is asked to hold it."""
    parts = [Part(0.0, constant(60.0)), Part(0.1, sine(150.0, 7.0, 0.0, 0.0))]
    hand = Hand(squeeze, arm=False)
    try:
        for block in run(Bench(p), Script(hand, 0.4, parts if squeeze is not None else [])):
            for event in block.events:
                if event.source == "simulation":
                    return event.message
    except DivergedError as error:
        return str(error)
    return "ran"


ONE_STAGE = {"gearbox.stages": 1, "gearbox.stage1.ratio": 10.0}


@pytest.mark.parametrize(
    ("values", "key", "word", "substeps"),
    [
        ({"gearbox.stage1.stiffness": 1e6}, "gearbox.stage1.stiffness", "high", 8),
        ({"gearbox.stage1.inertia": 3e-6}, "gearbox.stage1.inertia", "low", 8),
        ({"gearbox.stages": 3, "gearbox.stage3.stiffness": 3e7}, "gearbox.stage3.stiffness", "high", 9),
        ({"load_cell.stiffness": 3e8}, "load_cell.stiffness", "high", 4),
        ({"limb.tight_stiffness": 1e9}, "limb.tight_stiffness", "high", 4),
        ({"linkage.kind": "none", "load_cell.stiffness": 3e8}, "load_cell.stiffness", "high", 8),
        ({"gearbox.stages": 0, "load_cell.stiffness": 9e8}, "load_cell.stiffness", "high", 8),
        ({**ONE_STAGE, "gearbox.stage1.stiffness": 5e6}, "gearbox.stage1.stiffness", "high", 8),
        ({"rates.current_cycle": 100e-6}, "rates.current_cycle", "high", 2),
    ],
)  # fmt: skip
def test_blames_the_parameter_and_names_a_step_that_carries_it(
    values: dict[str, object], key: str, word: str, substeps: int
) -> None:
    found = unstable_parameter(with_parameters(values))
    assert found is not None
    assert found[0] == key
    assert f"{values[key]:g}" in found[1]
    assert f"too {word} for a plant step of" in found[1]
    enough = int(found[1].partition("simulation.substeps = ")[2].partition(" ")[0])
    assert 1 < enough <= substeps
    fine = with_parameters(values, enough)
    assert unstable_parameter(fine) is None
    assert shaken(fine) == "ran"


def test_a_stage_that_is_not_in_use_is_not_looked_at() -> None:
    stiff = {"stiffness": 1e9}
    for stages, beyond in ((2, "stage3"), (1, "stage2")):
        gearbox = Gearbox.model_validate({"stages": stages, beyond: stiff})
        assert unstable_parameter(Parameters(gearbox=gearbox).with_nameplate()) is None
    massless = Linkage(kind="none", rod_end_mass=0.0)
    assert unstable_parameter(Parameters(linkage=massless).with_nameplate()) is None


@pytest.mark.parametrize(
    "values",
    [
        {"gearbox.stage2.stiffness": 1e8},
        {"load_cell.stiffness": 9e8},
        {"gearbox.stages": 0, "load_cell.stiffness": 9e8},
        {"linkage.kind": "none", "load_cell.stiffness": 9e8},
    ],
)
def test_what_it_refuses_would_have_diverged(monkeypatch: pytest.MonkeyPatch, values: dict[str, object]) -> None:
    stiff = with_parameters(values)
    with pytest.raises(InputError, match=r"parameters\..*stiffness: .* is too high"):
        Bench(stiff)
    monkeypatch.setattr("cls_bench.bench.check_step", lambda p: None)
    assert "diverged" in shaken(stiff)


def _random_rig(draw: Callable[[float, float], float]) -> Parameters:
    """A rig from the far corners: any stages, undamped meshes and cell, lossy up to self-locking."""
    p = changed(Parameters(), "gearbox.stages", int(draw(0, 3.99)))
    for number in range(1, p.gearbox.stages + 1):
        kind = ("planetary", "spur", "belt", "worm")[int(draw(0, 3.99))]
        for name, value in (
            ("kind", kind), ("teeth", 0 if kind == "belt" else int(draw(1, 30))), ("ratio", draw(2, 12)),
            ("stiffness", 10 ** draw(3, 6)), ("inertia", 10 ** draw(-5.5, -3)), ("damping_ratio", 0.0),
            ("backlash", 10 ** draw(-4, -2)), ("transmission_error", 10 ** draw(-5, -3)), ("drag", draw(0, 0.5)),
            ("efficiency", draw(0.4, 1)), ("backdrive_efficiency", draw(-0.5, 1)), ("ripple", draw(0, 1)),
        ):  # fmt: skip
            p = changed(p, f"gearbox.stage{number}.{name}", value)
    p = changed(p, "load_cell.stiffness", 10 ** draw(5.5, 8))
    p = changed(p, "load_cell.damping_ratio", 0.0)
    return changed(p, "linkage.kind", "four_bar" if draw(0, 1) < 0.7 else "none")


@pytest.mark.parametrize("seed", range(12))
def test_what_it_lets_through_runs(seed: int) -> None:
    random = np.random.default_rng(seed)
    p = _random_rig(lambda low, high: float(random.uniform(low, high)))
    while (found := unstable_parameter(p)) is not None:
        assert "carries it" in found[1]
        enough = int(found[1].partition("simulation.substeps = ")[2].partition(" ")[0])
        p = changed(p, "simulation.substeps", enough)
    assert shaken(p) == "ran"
    assert shaken(p, None) == "ran"


def test_defaults_pass_with_room() -> None:
    check_step(Parameters())
    sixteen = Rates(
        current_cycle=62.5e-6, velocity_cycle=250e-6, position_cycle=500e-6, bus_cycle=500e-6, plc_cycle=500e-6
    )
    check_step(Parameters().model_copy(update={"rates": sixteen}))


def test_control_makes_no_difference() -> None:
    stiff = with_parameters({"gearbox.stage1.stiffness": 1e6})
    assert unstable_parameter(changed(stiff, "feel.inertia", 2.0)) == unstable_parameter(stiff)


def test_scenario_is_refused_at_load_with_the_key() -> None:
    with pytest.raises(InputError, match=r"parameters\.load_cell\.stiffness: 1e\+09 N/m is too high"):
        parse_scenario(f"{HEADER}\n[parameters.load_cell]\nstiffness = 1e9\n")


def test_a_change_in_mid_run_is_refused_at_load() -> None:
    with pytest.raises(InputError, match=r"changes\[0\]\.parameters\.limb\.tight_stiffness: 1e\+09 N/m is too high"):
        parse_scenario(f'{HEADER}\n[[changes]]\nat = 0.5\nparameters = {{ "limb.tight_stiffness" = 1e9 }}\n')


def test_damping_that_no_step_carries_is_said_so() -> None:
    with pytest.raises(InputError, match="no number of substeps carries it"):
        check_step(with_parameters({"limb.tight_damping": 1e6}))
