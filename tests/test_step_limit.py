import pytest

from cls_bench.bench import Bench
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.scenario import parse_scenario
from cls_bench.step_limit import check_step, unstable_parameter
from cls_bench.verification.random_trials import trial

HEADER = """
title = "step limit"
duration = 1.0
[[hand]]
at = 0.0
kind = "hold"
"""


def with_parameter(key: str, value: float, substeps: int = 1) -> Parameters:
    section, name = key.split(".") if key.count(".") == 1 else (key.rpartition(".")[0], key.rpartition(".")[2])
    text = f"{HEADER}\n[parameters.simulation]\nsubsteps = 64\n[parameters.{section}]\n{name} = {value!r}\n"
    p = parse_scenario(text).parameters_at_start()
    return p.model_copy(update={"simulation": p.simulation.model_copy(update={"substeps": substeps})})


@pytest.mark.parametrize(
    ("key", "value", "word", "substeps"),
    [
        ("gearbox.stage1.stiffness", 1e6, "high", 8),
        ("gearbox.carrier1_inertia", 3e-6, "low", 8),
        ("load_cell.stiffness", 3e8, "high", 4),
        ("limb.tight_stiffness", 1e9, "high", 4),
        ("linkage.rod_end_mass", 0.005, "low", 4),
    ],
)
def test_blames_the_parameter_and_names_a_step_that_carries_it(
    key: str, value: float, word: str, substeps: int
) -> None:
    found = unstable_parameter(with_parameter(key, value))
    assert found is not None
    assert found[0] == key
    assert f"{value:g}" in found[1]
    assert f"too {word} for a plant step of 50 µs" in found[1]
    assert unstable_parameter(with_parameter(key, value, substeps)) is None
    assert trial(with_parameter(key, value, substeps), seed=0) == "ran"


def test_what_it_refuses_would_have_diverged(monkeypatch: pytest.MonkeyPatch) -> None:
    stiff = with_parameter("gearbox.stage2.stiffness", 1e7)
    with pytest.raises(InputError, match=r"parameters\.gearbox\.stage2\.stiffness: 1e\+07 N·m/rad is too high"):
        Bench(stiff)
    monkeypatch.setattr("cls_bench.bench.check_step", lambda p: None)
    assert "diverged" in trial(stiff, seed=0)


def test_defaults_pass_with_room() -> None:
    check_step(Parameters())


def test_scenario_is_refused_at_load_with_the_key() -> None:
    with pytest.raises(InputError, match=r"parameters\.load_cell\.stiffness: 1e\+09 N/m is too high"):
        parse_scenario(f"{HEADER}\n[parameters.load_cell]\nstiffness = 1e9\n")


def test_a_change_in_mid_run_is_refused_at_load() -> None:
    with pytest.raises(InputError, match=r"changes\[0\]\.parameters\.limb\.tight_stiffness: 1e\+09 N/m is too high"):
        parse_scenario(f'{HEADER}\n[[changes]]\nat = 0.5\nparameters = {{ "limb.tight_stiffness" = 1e9 }}\n')


def test_no_step_carries_bristles_without_damping() -> None:
    with pytest.raises(InputError, match="no number of substeps carries it"):
        check_step(with_parameter("gearbox.bristle_stiffness", 1e6))
