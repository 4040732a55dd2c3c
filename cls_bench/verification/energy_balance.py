"""Energy audit of whole runs: the bench as it is used, with drive, hand and stop blocks, on any rig."""

from collections.abc import Iterator, Mapping

from cls_bench.analysis import energy
from cls_bench.bench import Bench
from cls_bench.drivers import scripted, timed
from cls_bench.hand import HandSamples
from cls_bench.parameters import ARCMIN, DEG, Gearbox, GearStage, Linkage, Parameters
from cls_bench.pilot import HandTimeline
from cls_bench.scenario import DriveStart, Ramp, Release, Scenario, Segment, Sine, Squeeze, Step
from cls_bench.signals import Block
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "energy"

OFF = DriveStart(power="off")

SWEEP: list[Segment] = [Sine(at=0.0, amplitude_deg=10.0, frequency=0.7, fade=0.5)]

RUNS = (
    Scenario(title="hand sweeps ±10°, drive on", seed=1, duration=3.0, hand=SWEEP),
    Scenario(title="back-driven, drive off", seed=1, duration=3.0, drive=OFF, hand=SWEEP),
    Scenario(
        title="thrown against the stop blocks, drive off", seed=1, duration=1.5, drive=OFF,
        hand=[Step(at=0.0, to_N=120.0), Step(at=0.7, to_N=-120.0)],
    ),
    Scenario(
        title="unstable, tight grip", seed=1, duration=2.0, parameters={"feel.inertia": 0.15},
        hand=[Sine(at=0.0, amplitude_deg=5.0, frequency=1.0, fade=0.3)], squeeze=[Squeeze(at=0.5, value=1.0)],
    ),
    Scenario(
        title="let go at 8°", seed=1, duration=2.0,
        hand=[Ramp(at=0.0, to_deg=8.0, over=0.4, smooth=True), Release(at=0.6)],
    ),
)  # fmt: skip
"""Runs on the thesis's rig that between them use every element that stores or loses energy."""

OTHERS = ("one_stage", "direct_drive", "belt", "non_backdrivable", "aileron")
"""Rigs that come with the bench; of stages, kinds and linkages no two are alike."""

SWEPT = Scenario(
    title="without power: swept, then pushed with 150 N", seed=1, duration=2.0, drive=OFF,
    hand=[Sine(at=0.0, amplitude_deg=10.0, frequency=1.0, fade=0.3), Step(at=1.0, to_N=150.0), Release(at=1.7)],
    squeeze=[Squeeze(at=0.5, value=1.0)],
)  # fmt: skip
FELT = Scenario(
    title="with power: swept, let go",
    seed=1,
    duration=2.0,
    hand=[Sine(at=0.0, amplitude_deg=8.0, frequency=1.0, fade=0.3), Release(at=1.3)],
)


def any_stages() -> Parameters:
    """Three stages of three kinds, each with all that a stage can have, and a motor that cogs."""
    p = Parameters(gearbox=Gearbox(
        stages=3,
        stage1=GearStage(
            kind="spur", ratio=2.5, teeth=17, inertia=6e-5, stiffness=1.0 / ARCMIN, backlash=4.0 * ARCMIN, drag=0.02,
            drag_ratio=1.5, efficiency=0.97, backdrive_efficiency=0.96, transmission_error=0.5 * ARCMIN,
        ),
        stage2=GearStage(
            kind="belt", ratio=2.0, teeth=0, inertia=1e-4, stiffness=2.0 / ARCMIN, damping_ratio=0.1, drag=0.03,
            drag_ratio=0.7, efficiency=0.98, backdrive_efficiency=0.98,
        ),
        stage3=GearStage(
            kind="planetary", ratio=4.25, inertia=2e-4, stiffness=6.0 / ARCMIN, backlash=3.0 * ARCMIN, drag=0.1,
            efficiency=0.95, backdrive_efficiency=0.93, transmission_error=0.3 * ARCMIN,
        ),
    ))  # fmt: skip
    motor = p.motor.model_copy(update={"cogging_amplitude": 0.01})
    return p.model_copy(update={"motor": motor}).with_nameplate()


def any_linkage() -> Parameters:
    """A four-bar with nothing upright at neutral, and a ratio that varies twofold over the travel."""
    link = Linkage(crank=0.12, rod=0.25, arm=0.15, crank_angle=10.0 * DEG, rod_angle=-8.0 * DEG, arm_angle=-5.0 * DEG)
    return Parameters(linkage=link).with_nameplate()


def rigs() -> Iterator[tuple[str, Parameters]]:
    """Rigs to be audited, by name."""
    for name in OTHERS:
        yield name, Scenario(title=name, duration=1.0, rig=name).parameters_at_start()
    yield "three stages", any_stages()
    yield "any four-bar", any_linkage()


def balance(subject: Subject) -> Iterator[Row]:
    """Work in less stored energy and losses, and what a loss ever gave back, both as parts of the throughput."""
    for scenario in RUNS:
        p = scenario.parameters_at_start()
        blocks = scripted.run(Bench(subject.alter(p), seed=scenario.seed), scenario)
        yield from _rows(scenario.title, energy.audit(blocks, p))
    for name, p in rigs():
        for scenario in (SWEPT, FELT):
            blocks = scripted.run(Bench(subject.alter(p), seed=scenario.seed), scenario.on(p))
            yield from _rows(f"{name}, {scenario.title}", energy.audit(blocks, p))
    yield from _side_by_side(subject)


def _side_by_side(subject: Subject) -> Iterator[Row]:
    """Two axes of one bench, each with books of its own."""
    axes = {"pitch": any_stages(), "roll": Scenario(title="roll", duration=1.0, rig="aileron").parameters_at_start()}
    blocks = list(_together({axis: subject.alter(p) for axis, p in axes.items()}))
    for axis, p in axes.items():
        yield from _rows(f"{axis} of two axes, {FELT.title}", energy.audit(blocks, p, axis))


def _together(axes: Mapping[str, Parameters]) -> Iterator[Block]:
    """The run of :data:`FELT` on all ``axes`` of one bench."""
    timeline = HandTimeline(FELT)

    def hands(first: int, ticks: int) -> list[HandSamples]:
        return [timeline.sample(first, ticks)] * len(axes)

    return timed.run(Bench(axes, seed=FELT.seed), hands, (), FELT.duration)


def _rows(name: str, audit: energy.EnergyAudit) -> Iterator[Row]:
    yield Row(GROUP, f"{name}: energy not accounted for, of the throughput", "1", 0.0, "first law",
              audit.relative_residual, 0.002, relative=False)  # fmt: skip
    given_back = max(*audit.returned.values(), -min(audit.losses.values())) / audit.throughput
    yield Row(GROUP, f"{name}: most that a loss gave back, of the throughput", "1", 0.0, "second law",
              given_back, 1e-4, relative=False)  # fmt: skip
