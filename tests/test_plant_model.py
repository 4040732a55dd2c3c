"""The MJCF and what the parameters make of it: equal defaults, no warnings, and table 3.3 from MuJoCo's mass matrix."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from cls_bench.parameters import Parameters
from cls_bench.plant import model as plant_model
from cls_bench.plant import state
from cls_bench.resources import model_folder
from tests.plant_rig import Element, parameters

FILES = sorted(model_folder().glob("*.xml"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_model_file_steps_without_a_warning(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.ctrl[0] = 10.0
    mujoco.mj_step(model, data, nstep=4000)
    assert np.isfinite(data.qpos).all()
    assert abs(data.qpos[0]) > 0.1  # the motor turned
    assert data.warning.number.sum() == 0
    assert not Path("MUJOCO_LOG.TXT").exists()


def arrays(struct: object) -> dict[str, object]:
    names = (name for name in dir(struct) if not name.startswith("_"))
    values = {name: getattr(struct, name) for name in names}
    return {name: v for name, v in values.items() if isinstance(v, (np.ndarray, int, float))}


def test_the_numbers_in_the_mjcf_are_the_defaults():
    file = mujoco.MjModel.from_xml_path(str(model_folder() / "scene.xml"))
    made = plant_model.build_spec(Parameters()).compile()
    for name, expected in {**arrays(made), **arrays(made.opt)}.items():
        found = getattr(file, name) if hasattr(file, name) else getattr(file.opt, name)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12, err_msg=name)


def test_the_laws_refuse_a_model_of_another_layout():
    spec = plant_model.build_spec(Parameters())
    spec.delete(spec.tendon("grip"))
    model = spec.compile()
    with pytest.raises(ValueError, match=r"the model's tendons are .*, expected"):
        state.view(model, mujoco.MjData(model))


def reflected_inertia(p: Parameters) -> float:
    """Inertia at the motor shaft: M of MuJoCo at neutral, projected on the one motion that gears and linkage allow.

    The meshes' and the load cell's springs are held at zero twist; the limb is not gripped.
    """
    joints = ("motor", "carrier1", "crank", "rod", "load_cell", "column")
    rig = Element(p, joints, ("stage1", "stage2", "linkage_closure"))
    m, d = rig.model, rig.data
    mujoco.mj_forward(m, d)
    mass = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, mass)
    closure = np.zeros((d.nefc, m.nv))
    for row in range(d.nefc):
        unit = np.zeros(d.nefc)
        unit[row] = 1.0
        mujoco.mj_mulJacTVec(m, d, closure[row], unit)
    meshes = np.zeros((2, m.nv))
    meshes[0, :2] = 1 / p.gearbox.ratio, -1
    meshes[1, 1:3] = 1 / p.gearbox.ratio, -1
    cell = np.eye(m.nv)[4:5]
    _, values, vectors = np.linalg.svd(np.vstack([closure, meshes, cell]))
    assert np.sum(values > 1e-9) == m.nv - 1  # one degree of freedom is left
    motion = vectors[-1] / vectors[-1][0]
    return float(motion @ mass @ motion)


@pytest.mark.parametrize(
    ("component", "share", "printed"),
    [
        ("motor", {"motor": {"rotor_inertia": 4.0e-5 / 2}}, 4.00e-5),
        ("servo crank", {"linkage": {"crank_inertia": 9.40e-4 / 2}}, 0.15e-5),
        ("coupler part 1", {"linkage": {"rod_crank_mass": 0.125 / 2}}, 0.20e-5),
        ("control column", {"column": {"inertia": 3.51e-2 / 2}}, 1.83e-5),
        ("coupler part 2", {"linkage": {"rod_column_mass": 0.3755 / 2}}, 0.60e-5),
    ],
)
def test_components_reflect_as_table_3_3_says(component, share, printed):
    """Half of a component taken away takes half of its reflected inertia away: M is linear in the masses."""
    half = reflected_inertia(Parameters()) - reflected_inertia(parameters(**share))
    assert 2 * half == pytest.approx(printed, rel=0.01), component


def test_gearbox_and_total_reflect_as_table_3_3_says():
    p = Parameters()
    box = p.gearbox
    parts = {"input_inertia": box.input_inertia, "carrier1_inertia": box.carrier1_inertia,
             "carrier2_inertia": box.carrier2_inertia}  # fmt: skip
    half = reflected_inertia(p) - reflected_inertia(parameters(gearbox={key: v / 2 for key, v in parts.items()}))
    assert 2 * half == pytest.approx(2.49e-5, rel=0.01)
    total = reflected_inertia(p)
    assert total == pytest.approx(9.27e-5, rel=0.01)
    assert (total - p.motor.rotor_inertia) / p.motor.rotor_inertia == pytest.approx(1.32, rel=0.01)
    assert total == pytest.approx(p.drive.load_inertia, rel=0.01)  # what the drive's gains are designed for


def test_a_damped_tendon_adds_no_inertia():
    """The grip's damper between column and forearm must not resist their common motion (semi-implicit Euler)."""
    rig = Element(Parameters(), ("column", "limb"), ("grip",))
    rig.model.tendon_damping[0] = 13.5
    inertia = np.array([3.51e-2, 1.8 * 0.3**2])
    rig.data.qfrc_applied[:] = 10.0 * inertia
    rig.model.dof_damping[:] = 0.0
    for _ in range(200):
        rig.step()
    assert rig.data.qvel / (10.0 * rig.data.time) == pytest.approx([1.0, 1.0], rel=1e-4)


def test_without_its_looks_the_bench_moves_the_same():
    """Shapes, sites, cameras and lights are left out where it is stepped; nothing else may change by that."""
    looked_at, stepped = (
        spec.compile() for spec in (plant_model.build_spec(Parameters()), plant_model.stepped_spec(Parameters()))
    )
    assert looked_at.ngeom > 30
    assert stepped.ngeom == stepped.nsite == stepped.ncam == stepped.nlight == 0
    names = [[model.body(i).name for i in range(model.nbody)] for model in (looked_at, stepped)]
    assert names[0] == names[1]
    paths = []
    for model in (looked_at, stepped):
        data = mujoco.MjData(model)
        data.ctrl[0] = 12.0
        mujoco.mj_step(model, data, 400)
        paths.append((data.qpos.copy(), data.qvel.copy(), data.act.copy(), data.xpos.copy()))
    assert abs(paths[0][0][0]) > 0.01
    for one, other in zip(*paths, strict=True):
        np.testing.assert_array_equal(one, other)
