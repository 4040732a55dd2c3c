"""Stills and videos of the bench as MuJoCo draws it, from a recording alone."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.claims import replaced
from cls_bench.errors import InputError, OutputError
from cls_bench.geometry import force_arrows, turned
from cls_bench.recording import Recording
from cls_bench.report.drawn_model import check_time, model_file, model_xml
from cls_bench.signals import axes_of
from cls_bench.text import printable

Image = NDArray[np.uint8]

SIZE = (1280, 800)
CAMERA = "bench"
_ARROW_COLORS = ((0.90, 0.62, 0.0, 1.0), (0.34, 0.71, 0.91, 1.0))
_ARROW_RADIUS = 0.006  # [m]

FURTHEST = 100.0
"""Greatest coordinate of a body that is drawn [m]."""


_FORCES = (("/pilot", "hand_force"), ("/load_cell", "force"))


class _Arrows:
    """The forces on the column of one axis. KeyError if the model has no such column."""

    def __init__(self, model: Any, axis: str):
        self._prefix = f"{axis}/" if axis else ""
        bodies = [model.body(k).name for k in range(model.nbody)]
        self._column = model.body(f"{self._prefix}column").id
        end = f"{self._prefix}rod_end"
        self._rod_end = bodies.index(end) if end in bodies else None
        self._grip_height = float(model.site(f"{self._prefix}grip").pos[2])

    def topic(self, path: str) -> str:
        """The topic of this axis."""
        return f"/{self._prefix}{path.lstrip('/')}"

    def along(self, poses: NDArray[np.float64], hand: NDArray[np.float64], rod: NDArray[np.float64]) -> Any:
        """Origins and vectors of the arrows at every row of ``poses``."""
        rod_end = None if self._rod_end is None else poses[:, self._rod_end]
        return force_arrows(poses[:, self._column], rod_end, hand, rod, self._grip_height)


class Renderer:
    """Draws the bodies of a recording where it says they were. InputError if there is no model or no OpenGL."""

    def __init__(self, recording: Recording, size: tuple[int, int] = SIZE, camera: str = CAMERA):
        self._recording = recording
        xml = model_xml(recording)
        try:
            spec = mujoco.MjSpec.from_string(xml)
            spec.visual.global_.offwidth, spec.visual.global_.offheight = size
            self._model = spec.compile()
            self._axes = [_Arrows(self._model, axis) for axis in axes_of(recording.topics.values())]
        except (ValueError, KeyError, TypeError) as error:
            reason = printable(str(error), 300)
            raise InputError(f"{recording.path}: its {model_file(recording)} cannot be drawn: {reason}") from None
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)  # cameras and lights stand in the world; the bodies come later
        cameras = [self._model.camera(k).name for k in range(self._model.ncam)]
        if camera not in cameras:
            raise InputError(f'there is no camera "{camera}"; valid: {", ".join(cameras)}')
        self._camera = camera
        try:
            self._renderer = mujoco.Renderer(self._model, height=size[1], width=size[0])
        except Exception as error:  # each OpenGL library has errors of its own
            raise InputError(f"OpenGL cannot start ({error}); try MUJOCO_GL=osmesa, or egl") from None

    def close(self) -> None:
        """Give the memory back."""
        self._renderer.close()

    def still(self, at: float) -> Image:
        """The bench at ``at`` [s], shape (height, width, 3). InputError outside of the recording."""
        check_time(self._recording, at)
        period = self._recording.clock.pose_ticks * self._recording.clock.tick_s
        at = min(at, self._recording.duration - period)
        image = next(self.frames(at, at + 2 * period, period), None)
        if image is None:
            raise InputError(f"{self._recording.path}: there are no poses at {at:g} s")
        return image

    def frames(self, start: float, end: float, step: float) -> Iterator[Image]:
        """The bench every ``step`` [s], at most as often as there are poses."""
        time, poses = self._recording.poses(start, end)
        clock = self._recording.clock
        every = max(round(step / (clock.pose_ticks * clock.tick_s)), 1)
        if not len(time):
            return
        if poses.shape[1] != self._model.nbody or not np.abs(poses).max() <= FURTHEST:
            raise InputError(f"{self._recording.path}: its poses are not those of its model")
        arrows = [
            axis.along(poses, *(self._force(time, axis.topic(path), name) for path, name in _FORCES))
            for axis in self._axes
        ]
        for row in range(0, len(time), every):
            yield self._draw(poses[row], [(origins[row], vectors[row]) for origins, vectors in arrows])

    def _force(self, time: NDArray[np.float64], topic: str, name: str) -> NDArray[np.float64]:
        """A force at ``time`` [N]; 0, which draws no arrow, where it was not recorded."""
        known, tick = self._recording.topics.get(topic), self._recording.clock.tick_s
        if known is None or name not in known.names:
            return np.zeros(len(time))
        series = self._recording.read(topic, [name], float(time[0]), float(time[-1]) + tick)
        if not len(series):
            return np.zeros(len(time))
        place = np.clip(np.searchsorted(series.time, time - 0.5 * tick), 0, len(series) - 1)
        there = np.abs(series.time[place] - time) < known.ticks * tick
        return np.where(there & (np.abs(series[name][place]) < 1e6), series[name][place], 0.0)

    def _draw(self, poses: NDArray[np.float64], arrows: Sequence[tuple[Any, Any]]) -> Image:
        model, data = self._model, self._data
        bodies = poses[model.geom_bodyid]
        data.geom_xpos[:] = bodies[:, :3] + turned(bodies[:, 3:], model.geom_pos)
        for geom, (body, own) in enumerate(zip(bodies[:, 3:], model.geom_quat, strict=True)):
            quaternion = np.zeros(4)
            mujoco.mju_mulQuat(quaternion, body, own)
            mujoco.mju_quat2Mat(data.geom_xmat[geom], quaternion)
        self._renderer.update_scene(data, self._camera)
        for origins, vectors in arrows:
            for origin, vector, color in zip(origins, vectors, _ARROW_COLORS[: len(origins)], strict=True):
                self._add_arrow(origin, vector, color)
        return np.asarray(self._renderer.render())

    def _add_arrow(self, origin: Any, vector: Any, color: tuple[float, ...]) -> None:
        scene = self._renderer.scene
        if np.linalg.norm(vector) < _ARROW_RADIUS or scene.ngeom >= scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        arrow = mujoco.mjtGeom.mjGEOM_ARROW
        mujoco.mjv_initGeom(geom, arrow, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(color, np.float32))
        mujoco.mjv_connector(geom, arrow, _ARROW_RADIUS, origin, origin + vector)
        scene.ngeom += 1


def save_still(recording: Recording, at: float, path: Path, size: tuple[int, int] = SIZE, camera: str = CAMERA) -> None:
    """Write a still as PNG. Raises InputError and OutputError."""
    from PIL import Image as Pillow

    check_time(recording, at)
    renderer = Renderer(recording, size, camera)
    try:
        image = Pillow.fromarray(renderer.still(at))
    finally:
        renderer.close()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as file:
            image.save(file)
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot write {path}: {error}") from None


def save_video(
    recording: Recording, path: Path, start: float, end: float, *, speed: float = 1.0, rate: int = 50,
    size: tuple[int, int] = SIZE, camera: str = CAMERA,
) -> int:  # fmt: skip
    """Write an MP4 of ``rate`` frames a second that plays ``speed`` times as fast as the run; returns its frames.

    Raises InputError and OutputError.
    """
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InputError("a video needs ffmpeg: pip install 'cls-bench[video]'") from None
    check_time(recording, start)
    renderer = Renderer(recording, size, camera)
    frames = 0
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as file:
            writer = imageio_ffmpeg.write_frames(str(file), size, fps=rate, quality=8, macro_block_size=2)
            writer.send(None)
            for image in renderer.frames(start, end, speed / rate):
                writer.send(np.ascontiguousarray(image))
                frames += 1
            writer.close()
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error}") from None
    finally:
        renderer.close()
    return frames
