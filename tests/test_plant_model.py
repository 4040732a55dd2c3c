"""The stepped model and the drawn one: table 3.3 from the inertias, axes found by name, weights that change; the MJCF
of every rig opens as a moving linkage and goes where the stepped model goes."""

import itertools
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cls_bench.bench import Bench
from cls_bench.kinematics import crank_from_column, crank_ratio, rod_angle
from cls_bench.parameters import Gearbox, Linkage, Parameters, Simulation
from cls_bench.plant import mechanism, mjcf, shapes
from cls_bench.plant import model as plant_model
from cls_bench.plant.state import JOINTS
from cls_bench.resources import model_folder
from cls_bench.rigs import load_rig
from cls_bench.verification import rigs as verified
from cls_bench.verification.reduced_model import Guide
from cls_bench.verification.subject import Feedback, Specimen
from cls_bench.verification.twin import Twin
from tests.running import off, parameters

P = Parameters()
FILES = sorted(model_folder().glob("*.xml"))
SHIPPED = sorted(path.stem for path in (model_folder() / "rigs").glob("*.toml"))


def all_rigs() -> dict[str, Parameters]:
    """The shipped rigs by name, and those of the verification."""
    return {name: load_rig(name).parameters for name in SHIPPED} | {
        f"verified {name}": p for name, p in verified.rigs().items()
    }


RIGS = all_rigs()


# --- the stepped model ---


def at_motor(p: Parameters) -> float:
    """Inertia [kg·m²] at the motor shaft: what is stepped, moved as gears and linkage allow it, at neutral."""
    rig = Specimen(p)
    rig.run(np.zeros(1))  # writes the far mass into crank and column
    rig.data.qpos[:] = rig.data.qvel[:] = 0.0
    mujoco.mj_forward(rig.model, rig.data)
    mass = np.zeros((rig.model.nv, rig.model.nv))
    mujoco.mj_fullM(rig.model, rig.data, mass)
    assert (mass == np.diag(np.diag(mass))).all()
    crank, motion = 1.0 / p.gearbox.ratio, np.zeros(rig.model.nv)
    passed = 1.0
    for name, stage in itertools.zip_longest(rig.shafts, p.gearbox.in_use):
        motion[rig.joints.index(name)] = passed
        passed /= stage.ratio if stage else 1.0
    motion[rig.joints.index("column")] = crank / crank_ratio(p.linkage.four_bar, 0.0, 0.0)
    return float(motion @ mass @ motion)


@pytest.mark.parametrize(
    ("component", "key", "printed"),
    [
        ("motor", "motor.rotor_inertia", 4.00e-5),
        ("servo crank", "linkage.crank_inertia", 0.15e-5),
        ("coupler part 1", "linkage.rod_crank_mass", 0.20e-5),
        ("control column", "column.inertia", 1.83e-5),
        ("coupler part 2", "linkage.rod_column_mass", 0.60e-5),
    ],
)
def test_components_reflect_as_table_3_3_says(component, key, printed):
    """Half of a component taken away takes half of its reflected inertia away: M is linear in the masses.

    Of coupler part 2 the far share moves with the crank's pin, which at neutral is as fast as the column's.
    """
    section, name = key.split(".")
    half = at_motor(P) - at_motor(parameters({key: getattr(getattr(P, section), name) / 2}))
    assert 2 * half == pytest.approx(printed, rel=0.01), component


def test_gearbox_and_total_reflect_as_table_3_3_says():
    box = P.gearbox
    halves = {"gearbox.input_inertia": box.input_inertia / 2, "gearbox.stage1.inertia": box.stage1.inertia / 2,
              "gearbox.stage2.inertia": box.stage2.inertia / 2}  # fmt: skip
    assert 2 * (at_motor(P) - at_motor(parameters(halves))) == pytest.approx(2.49e-5, rel=0.01)
    total = at_motor(P)
    assert total == pytest.approx(9.27e-5, rel=0.01)
    assert (total - P.motor.rotor_inertia) / P.motor.rotor_inertia == pytest.approx(1.32, rel=0.01)
    assert total == pytest.approx(P.nameplate.load_inertia, rel=0.01)  # what the drive's gains are designed for


@pytest.mark.parametrize("name", RIGS)
def test_the_nameplate_has_the_inertia_that_is_stepped(name):
    """At neutral; where the arm does not stand across the rod, table 3.3's sum is of the same parts in other shares."""
    p = RIGS[name]
    link = p.linkage
    across = link.kind == "four_bar" and abs(math.sin(link.arm_angle - link.rod_angle)) > 0.1
    assert p.nameplate.load_inertia == pytest.approx(at_motor(p), rel=0.05 if across else 0.01)


def test_axes_are_found_by_name():
    """Two axes of other numbers of stages: each has its own joints, all different, in the order of the shafts."""
    axes = {"pitch": P, "roll": RIGS["verified three stages"], "yaw": RIGS["direct_drive"]}
    model = plant_model.build(axes)
    taken = []
    for name, p in axes.items():
        joints = np.zeros(1, JOINTS).view(np.recarray)[0]
        plant_model.find_joints(model, name, p.gearbox.stages, joints)
        shafts = plant_model.shaft_names(p.gearbox.stages)
        for k, shaft in enumerate(shafts):
            assert model.joint(int(joints.shafts[k])).name == f"{name}/{shaft}"
        assert set(joints.shafts[len(shafts) :]) <= {joints.crank}
        assert joints.motor == joints.shafts[0] and joints.crank == joints.shafts[len(shafts) - 1]
        assert model.joint(int(joints.column)).name == f"{name}/column"
        assert model.joint(int(joints.limb)).name == f"{name}/limb"
        taken += [int(joints.column), int(joints.limb), *map(int, joints.shafts[: len(shafts)])]
    assert sorted(taken) == list(range(model.nv))
    with pytest.raises(KeyError, match="pitch/carrier2"):
        plant_model.find_joints(plant_model.build({"pitch": P}), "pitch", 3, np.zeros(1, JOINTS).view(np.recarray)[0])


@pytest.mark.parametrize("axis", ["", "roll"])
def test_weights_change_in_the_compiled_model_as_if_built_so(axis):
    """Masses, centres and inertias of one axis, and what MuJoCo derives from them; another axis stays as it is."""
    other = parameters({
        "limb.mass": 3.0, "column.mass": 1.1, "column.mass_height": 0.1, "column.inertia": 0.05,
        "linkage.rod_end_mass": 0.2, "motor.rotor_inertia": 9e-5, "gearbox.stage1.inertia": 2e-4,
    })  # fmt: skip
    axes = {axis: P} if not axis else {"pitch": P, axis: P}
    changed, built = plant_model.build(axes), plant_model.build({**axes, axis: other})
    plant_model.set_weights(changed, axis, other)
    for field in ("body_mass", "body_ipos", "body_inertia", "dof_M0", "dof_invweight0", "body_subtreemass"):
        np.testing.assert_allclose(getattr(changed, field), getattr(built, field), rtol=1e-12, err_msg=field)
    before = changed.dof_M0.copy()
    plant_model.set_weights(changed, axis, other)
    np.testing.assert_array_equal(changed.dof_M0, before)
    plant_model.set_weights(changed, axis, P)
    np.testing.assert_allclose(changed.dof_M0, plant_model.build(axes).dof_M0, rtol=1e-12)


def test_what_is_stepped_has_nothing_to_solve():
    """Hinges with their inertias; no constraint, contact, tendon, actuator or shape that MuJoCo would look at."""
    model = plant_model.build({"a": P, "b": RIGS["verified worm"]})
    assert (model.njnt, model.nbody - 1) == (5 + 4, 5 + 4)
    for count in ("neq", "ntendon", "nu", "ngeom", "nsite", "nsensor", "nlight", "ncam", "nkey"):
        assert getattr(model, count) == 0, count
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=100)
    assert data.nefc == data.ncon == 0


# --- the drawn one ---


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_model_file_steps_without_a_warning(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.actuator("motor").ctrl = 10.0
    mujoco.mj_step(model, data, nstep=4000)
    assert np.isfinite(data.qpos).all()
    assert abs(data.joint("motor").qpos[0]) > 0.1
    assert data.warning.number.sum() == 0
    assert not Path("MUJOCO_LOG.TXT").exists()


def arrays(struct: object) -> dict[str, object]:
    names = (name for name in dir(struct) if not name.startswith("_"))
    values = {name: getattr(struct, name) for name in names}
    return {name: v for name, v in values.items() if isinstance(v, (np.ndarray, int, float))}


def test_the_numbers_in_the_mjcf_are_the_defaults():
    """What is drawn from the parameters of the thesis's rig is what the file says, array by array.

    Shapes come in another order, as the scene has the floor last.
    """
    file = mujoco.MjModel.from_xml_path(str(model_folder() / "scene.xml"))
    made = mjcf.build_spec(P).compile()
    shown = [made.geom(k).name for k in range(made.ngeom)]
    there = [file.geom(k).name for k in range(file.ngeom)]
    assert sorted(shown) == sorted(there) and len(set(shown)) == len(shown)
    order = [there.index(name) for name in shown]
    for name, expected in {**arrays(made), **arrays(made.opt)}.items():
        if name in ("name_geomadr", "names_map"):
            continue
        found = getattr(file, name) if hasattr(file, name) else getattr(file.opt, name)
        found = found[order] if name.startswith("geom_") else found
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("name", RIGS)
def test_the_mjcf_of_a_rig_opens_and_moves(name, tmp_path):
    """As a file, in MuJoCo and nothing else: it steps for 0.2 s under a voltage, the linkage closed, without a warning.

    The column turns as the closed form says of where the crank is, within what the load cell gives.
    """
    p = RIGS[name]
    (tmp_path / "rig.xml").write_text(mjcf.build_bench({"": p}).to_xml(), encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "rig.xml"))
    data = mujoco.MjData(model)
    linked = p.linkage.kind == "four_bar"
    mujoco.mj_forward(model, data)
    crank = "crank" if p.gearbox.stages else "motor"
    data.actuator("motor").ctrl = 0.2 * p.drive.voltage_limit
    moved = worst = closed = 0.0
    for _ in range(round(0.2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        column, turned = float(data.joint("column").qpos[0]), float(data.joint(crank).qpos[0])
        if abs(column) > 0.9 * p.column.travel:
            break
        moved = max(moved, abs(column))
        expected = crank_from_column(p.linkage.four_bar, column) if linked else column
        worst = max(worst, abs(turned - expected))
        if linked:
            closed = max(closed, float(np.abs(data.efc_pos[: data.nefc]).max()))
    assert data.warning.number.sum() == 0
    assert moved > 0.02
    assert worst < 0.02
    assert closed < 1e-5
    assert not Path("MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize("name", RIGS)
def test_the_drawn_linkage_closes_at_the_closed_form(name):
    """Over the whole travel: the rod's two ends meet, the closing constraint has nothing to do."""
    p = RIGS[name]
    bar = p.linkage.four_bar
    model = mjcf.build_spec(p, scene=False).compile()
    data = mujoco.MjData(model)
    if p.linkage.kind == "none":
        assert model.neq == 0 and "rod" not in {model.joint(k).name for k in range(model.njnt)}
        return
    for column in np.linspace(-1.0, 1.0, 21) * p.column.travel:
        crank = crank_from_column(bar, column)
        data.joint("crank" if p.gearbox.stages else "motor").qpos = crank
        data.joint("rod").qpos = rod_angle(bar, crank, column) - bar.rod_angle - crank
        data.joint("column").qpos = column
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.nefc]).max() < 1e-9


def swing(p: Parameters, time: np.ndarray) -> tuple[np.ndarray, Guide]:
    """Torque of a hand on the column [N·m], and a guide that swings the motor by 0.3 of the travel against it."""
    grown = np.minimum(time / 0.02, 1.0)
    ratio, inertia = p.gearbox.ratio * abs(crank_ratio(p.linkage.four_bar, 0.0, 0.0)), at_motor(p)
    angle = 0.3 * p.column.travel * ratio * np.sin(2 * np.pi * 5.0 * time) * grown
    hand = p.load_cell.capacity * p.linkage.arm / 7.0 * np.cos(2 * np.pi * 13.0 * time) * grown
    return hand, Guide(2e4 * inertia, 500.0 * inertia, angle, np.gradient(angle, time[1] - time[0]))


def of_two_drags(drag_ratio: float) -> Parameters:
    """One stage that rubs less, or more, when it is back-driven."""
    p = verified.rigs()["one stage"]
    stage = p.gearbox.stage1.model_copy(update={"drag_ratio": drag_ratio})
    return p.model_copy(update={"gearbox": p.gearbox.model_copy(update={"stage1": stage})})


TWINS = {**verified.rigs(), "less drag back-driven": of_two_drags(0.2), "more drag back-driven": of_two_drags(2.5)}


@pytest.mark.parametrize("name", TWINS)
def test_the_drawn_model_goes_where_the_stepped_one_goes(name):
    """MuJoCo's own elements (closing constraint, tendons, LuGre actuators) against the compiled laws, for 0.1 s.

    Both with the same hand and the motor guided alike, in steps of 1.6 µs: the column's angle within 10⁻⁴ of its swing,
    and the torque that the guide needs within two thousandths of its greatest.
    """
    p = TWINS[name].model_copy(update={"simulation": Simulation(substeps=32)})
    stepped, drawn = Specimen(p), Twin(p)
    assert drawn.step == stepped.step
    time = stepped.times(0.1)
    hand, guide = swing(p, time)
    motor, acted = stepped.shafts[0], {}
    found = stepped.run(
        time, {"column": hand}, feedback={motor: Feedback(guide.stiffness, guide.damping)},
        target={motor: guide.angle}, acted=acted,
    ).angle["column"]  # fmt: skip
    expected, torque = drawn.run(hand, guide)
    assert np.ptp(expected) > 0.25 * p.column.travel
    assert np.abs(found - expected).max() < 1e-4 * np.ptp(expected)
    assert np.abs(acted[motor] - torque).max() < 2e-3 * np.abs(torque).max()


def test_rigs_stand_side_by_side():
    """Several axes in one drawing: names begin with the axis, nothing overlaps, and each moves as it does alone."""
    axes = {"pitch": P, "roll": RIGS["verified belt"], "yaw": RIGS["verified motor on the column"]}
    places = mjcf.places(axes)
    assert places["pitch"] == 0.0 and list(places) == list(axes)
    edges = [(places[name] + float(low[1]), places[name] + float(high[1])) for name, (low, high) in (
        (name, shapes.layout(p).bounds) for name, p in axes.items())]  # fmt: skip
    for (_, end), (begin, _) in itertools.pairwise(edges):
        assert begin - end == pytest.approx(mjcf.GAP)
    spec = mjcf.build_bench(axes)
    model = spec.compile()
    names = [model.joint(k).name for k in range(model.njnt)]
    assert {name.partition("/")[0] for name in names} == set(axes)
    data = mujoco.MjData(model)
    for name in axes:
        data.actuator(f"{name}/motor").ctrl = 20.0
    mujoco.mj_step(model, data, nstep=2000)
    assert data.warning.number.sum() == 0
    for name, p in axes.items():
        alone = mjcf.build_spec(p, scene=False).compile()
        state = mujoco.MjData(alone)
        state.actuator("motor").ctrl = 20.0
        mujoco.mj_step(alone, state, nstep=2000)
        assert data.joint(f"{name}/column").qpos[0] == pytest.approx(state.joint("column").qpos[0], abs=1e-9)


@pytest.mark.parametrize("name", RIGS)
def test_poses_are_those_of_the_drawn_bodies(name):
    """What is recorded of the bodies' places is where MuJoCo puts the drawn ones, for angles all over the travel."""
    p = RIGS[name]
    bar = p.linkage.four_bar
    resting = mjcf.rest(p)
    drawn = mjcf.build_spec(p).compile()
    assert [drawn.body(k).name for k in range(1, drawn.nbody)] == [body.name for body in resting]
    data, rig = mujoco.MjData(drawn), Specimen(p)
    shafts = {name: mechanism.ANGLES.index(f"shaft{k}") for k, name in enumerate(rig.shafts)}
    for column in np.array([-0.9, 0.3, 0.8]) * p.column.travel:
        crank = crank_from_column(bar, column) if bar.rod else column
        turned = {shaft: 2.0 * (k + 1) for k, shaft in enumerate(rig.shafts)} | {"crank": crank}
        rig.place(column=column, limb=0.1, **turned)
        for shaft, angle in turned.items():
            data.joint("motor" if shaft == rig.shafts[0] else shaft).qpos = angle
        data.joint("column").qpos, data.joint("limb").qpos = column, 0.1
        if bar.rod:
            data.joint("rod").qpos = rod_angle(bar, crank, column) - bar.rod_angle - crank
        mujoco.mj_forward(drawn, data)
        for body in resting:
            by = "rod_end" if body.name == "rod_end" else body.turned_by
            which = shafts["crank"] if by == "motor" and len(shafts) == 1 else shafts.get(by, -1)
            which = mechanism.ANGLES.index(by) if which < 0 else which
            angle, dx, dz = mechanism.pose(rig.plant, rig.truth, which)
            where = np.add(body.position, (dx, 0.0, dz))
            np.testing.assert_allclose(data.body(body.name).xpos, where, atol=1e-9, err_msg=body.name)
            quaternion = np.zeros(4)
            mujoco.mju_mulQuat(
                quaternion, np.array(body.quaternion), np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])
            )
            assert abs(float(quaternion @ data.body(body.name).xquat)) == pytest.approx(1.0, abs=1e-9), body.name


def test_several_axes_step_as_each_does_alone():
    """Axes share the model and nothing else."""
    axes = {"pitch": P, "roll": Parameters(gearbox=Gearbox(stages=0), linkage=Linkage(kind="none")).with_nameplate()}
    together = Bench(axes, seed=5)
    together.start(power=False)
    for axis in together.axes:
        together.plant.qpos[int(axis.record.truth.joints.column)] = 0.1
    block = together.advance([off(800)] * 2)
    for name, p in axes.items():
        alone = Bench(p, seed=5)
        alone.start(power=False)
        alone.plant.qpos[int(alone.axes[0].record.truth.joints.column)] = 0.1
        np.testing.assert_array_equal(block[f"/{name}/column.angle"], alone.advance(off(800))["/column.angle"])


OTHERS = {
    "thesis": {},
    "less far mass": {"linkage.rod_column_mass": 0.2},
    "no far mass": {"linkage.rod_column_mass": 0.15, "linkage.rod_end_mass": 0.15},
    "no weights": {"linkage.rod_crank_mass": 0.0, "linkage.rod_column_mass": 0.0, "linkage.rod_end_mass": 0.0,
                   "column.mass_height": 0.0},
    "shaft": {"linkage.kind": "none"},
    "other weights": {"limb.mass": 3.0, "column.inertia": 0.05},
}  # fmt: skip


@pytest.mark.parametrize(("first", "then"), list(itertools.permutations(OTHERS, 2)))
def test_nothing_of_a_rig_is_left_after_a_reset(first, then):
    """A bench that has run with one rig and is given another moves like a new one, to the last bit."""

    def swing(bench: Bench) -> np.ndarray:
        bench.start(power=False)
        bench.plant.qpos[int(bench.axes[0].record.truth.joints.column)] = 0.1
        return bench.advance(off(400))["/column.angle"].copy()

    p, other = (parameters(OTHERS[name]).with_nameplate() for name in (first, then))
    used = Bench(p, seed=5)
    swing(used)
    if p.linkage.kind != other.linkage.kind:
        with pytest.raises(ValueError, match="another kind of linkage need a new bench"):
            used.reset(other, seed=5)
        return
    used.reset(other, seed=5)
    np.testing.assert_array_equal(swing(used), swing(Bench(other, seed=5)))
