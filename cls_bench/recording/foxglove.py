"""Messages in Foxglove's own schemas, which its viewers draw without being told how: log, transforms, scene."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor_pb2 import (  # type: ignore[import-untyped]
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from numpy.typing import NDArray

from cls_bench.geometry import Geom, Vector, capsule_ends, plane_box
from cls_bench.signals import Event, Topic

MOST_BODIES, MOST_GEOMS = 200, 10_000
"""Bodies and shapes of a bench that are read; a file that has more is none of ours."""

WORLD = "world"
"""Frame to which all poses refer."""

LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}
"""Log levels of :class:`cls_bench.signals.Event` in Foxglove's terms."""

PACKAGE = "cls_bench"


def message_name(topic: Topic) -> str:
    """Name of the protobuf message of a topic: ``/load_cell`` -> ``cls_bench.LoadCell``."""
    words = topic.path.strip("/").replace("/", "_").split("_")
    return f"{PACKAGE}." + "".join(word.capitalize() for word in words)


def topic_schema(topic: Topic) -> bytes:
    """Serialized FileDescriptorSet of a message of doubles, one field a signal in column order."""
    file = FileDescriptorProto(name=f"{PACKAGE}{topic.path}.proto", package=PACKAGE, syntax="proto3")
    message = file.message_type.add(name=message_name(topic).removeprefix(f"{PACKAGE}."))
    for number, signal in enumerate(topic.signals, start=1):
        message.field.add(
            name=signal.name,
            number=number,
            type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
    return bytes(FileDescriptorSet(file=[file]).SerializeToString(deterministic=True))


def double_fields(schema: bytes, name: str) -> dict[int, str]:
    """Number -> name of the fields of type double of message ``name`` in a FileDescriptorSet, by their numbers.

    Raises DecodeError, and KeyError if it holds no such message.
    """
    for file in FileDescriptorSet.FromString(schema).file:
        for message in file.message_type:
            if f"{file.package}.{message.name}" == name:
                fields = {f.number: f.name for f in message.field if f.type == FieldDescriptorProto.TYPE_DOUBLE}
                return dict(sorted(fields.items()))
    raise KeyError(name)


def library_schema(message: Any) -> bytes:
    """Serialized FileDescriptorSet of a message class, its imports first."""
    files: dict[str, FileDescriptorProto] = {}

    def collect(descriptor: Any) -> None:
        for dependency in descriptor.dependencies:
            collect(dependency)
        if descriptor.name not in files:
            files[descriptor.name] = proto = FileDescriptorProto()
            descriptor.CopyToProto(proto)

    collect(message.DESCRIPTOR.file)
    return bytes(FileDescriptorSet(file=files.values()).SerializeToString(deterministic=True))


def _set_time(stamp: Any, time_ns: int) -> None:
    stamp.seconds, stamp.nanos = divmod(time_ns, 1_000_000_000)


def log(event: Event) -> bytes:
    """An event as ``foxglove.Log``."""
    message = Log(level=LEVELS[event.level], message=event.message, name=event.source)
    _set_time(message.timestamp, event.tick * event.tick_ns)
    return bytes(message.SerializeToString(deterministic=True))


def parse_log(data: bytes, tick: int, tick_ns: int) -> Event:
    """The event back from a ``foxglove.Log`` of ``tick``, which lasts ``tick_ns`` [ns]."""
    message = Log.FromString(data)
    level = next((name for name, value in LEVELS.items() if value == message.level), "info")
    return Event(tick, level, message.name, message.message, tick_ns)


class Transforms:
    """Encodes poses as ``foxglove.FrameTransforms``: every body but the world, relative to the world."""

    def __init__(self, body_names: Sequence[str]):
        self._message = FrameTransforms()  # filled anew for each row: four times cheaper than a new one
        for name in body_names[1:]:
            self._message.transforms.add(parent_frame_id=WORLD, child_frame_id=name)

    def __call__(self, time_ns: int, poses: NDArray[np.float64]) -> bytes:
        """Serialized message of ``poses``, shape (bodies, 7): position [m] and quaternion w, x, y, z; world first."""
        for transform, pose in zip(self._message.transforms, poses[1:].tolist(), strict=True):
            _set_time(transform.timestamp, time_ns)
            at, turn = transform.translation, transform.rotation
            at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z = pose
        return bytes(self._message.SerializeToString(deterministic=True))


def scene(body_names: Sequence[str], geoms: Sequence[Geom]) -> bytes:
    """All shapes as one ``foxglove.SceneUpdate``, an entity for every body, each in its body's frame."""
    update = SceneUpdate()
    for number, name in enumerate(body_names):
        shapes = [geom for geom in geoms if geom.body == number]
        if not shapes:
            continue
        entity = update.entities.add(frame_id=name if number else WORLD, id=name, frame_locked=True)
        for geom in shapes:
            for primitive in _primitives(geom):
                match primitive:
                    case CubePrimitive():
                        entity.cubes.append(primitive)
                    case CylinderPrimitive():
                        entity.cylinders.append(primitive)
                    case SpherePrimitive():
                        entity.spheres.append(primitive)
                    case TriangleListPrimitive():
                        entity.triangles.append(primitive)
    return bytes(update.SerializeToString(deterministic=True))


def parse_scene(data: bytes, body_names: Sequence[str]) -> tuple[Geom, ...]:
    """The shapes back from :func:`scene`: a plane as a box, a capsule as a cylinder and two spheres.

    Raises DecodeError and ValueError.
    """
    geoms: list[Geom] = []
    bodies = {name: number for number, name in enumerate(body_names)}
    for entity in SceneUpdate.FromString(data).entities:
        if entity.id not in bodies:
            continue
        body = bodies[entity.id]
        geoms += [_geom(body, "box", it, (it.size.x / 2, it.size.y / 2, it.size.z / 2)) for it in entity.cubes]
        geoms += [_geom(body, "cylinder", it, (it.size.x / 2, it.size.z / 2, 0.0)) for it in entity.cylinders]
        geoms += [_geom(body, "ellipsoid", it, (it.size.x / 2, it.size.y / 2, it.size.z / 2)) for it in entity.spheres]
        for mesh in entity.triangles:
            vertices = np.array([(p.x, p.y, p.z) for p in mesh.points], np.float32)
            faces = np.array(mesh.indices, np.int32).reshape(-1, 3)
            if faces.size and not 0 <= faces.min() <= faces.max() < len(vertices):
                raise ValueError("a mesh has faces without vertices")
            geoms.append(replace(_geom(body, "mesh", mesh, (0.0, 0.0, 0.0)), vertices=vertices, faces=faces))
        if len(geoms) > MOST_GEOMS:
            raise ValueError("too many shapes")
    return tuple(geoms)


def _geom(body: int, kind: str, primitive: Any, size: Vector) -> Geom:
    at, turn, color = primitive.pose.position, primitive.pose.orientation, primitive.color
    quaternion, rgba = (turn.w, turn.x, turn.y, turn.z), (color.r, color.g, color.b, color.a)
    return Geom(body, kind, size, (at.x, at.y, at.z), quaternion, rgba)


def parse_transforms(data: bytes) -> list[list[float]]:
    """Poses from :class:`Transforms`, the world's first: position [m] and quaternion w, x, y, z."""
    poses = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]
    for transform in FrameTransforms.FromString(data).transforms:
        at, turn = transform.translation, transform.rotation
        poses.append([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z])
    return poses


def parse_body_names(data: bytes) -> tuple[str, ...]:
    """The bodies' names from :class:`Transforms`, world first."""
    return (WORLD, *(transform.child_frame_id for transform in FrameTransforms.FromString(data).transforms))


def _primitives(
    geom: Geom,
) -> Iterator[CubePrimitive | CylinderPrimitive | SpherePrimitive | TriangleListPrimitive]:
    color = Color(**dict(zip("rgba", geom.rgba, strict=True)))
    x, y, z = (2.0 * half for half in geom.size)
    match geom.kind:
        case "box":
            yield CubePrimitive(pose=_pose(geom), size=Vector3(x=x, y=y, z=z), color=color)
        case "plane":
            size, position = plane_box(geom)
            x, y, z = (2.0 * half for half in size)
            yield CubePrimitive(pose=_pose(geom, position), size=Vector3(x=x, y=y, z=z), color=color)
        case "sphere":
            yield SpherePrimitive(pose=_pose(geom), size=Vector3(x=x, y=x, z=x), color=color)
        case "ellipsoid":
            yield SpherePrimitive(pose=_pose(geom), size=Vector3(x=x, y=y, z=z), color=color)
        case "cylinder" | "capsule":
            size = Vector3(x=x, y=x, z=y)
            yield CylinderPrimitive(pose=_pose(geom), size=size, bottom_scale=1.0, top_scale=1.0, color=color)
            if geom.kind == "capsule":
                for end in capsule_ends(geom):
                    yield SpherePrimitive(pose=_pose(geom, end), size=Vector3(x=x, y=x, z=x), color=color)
        case "mesh" if geom.vertices is not None and geom.faces is not None:
            points = [Point3(x=x, y=y, z=z) for x, y, z in geom.vertices.tolist()]
            indices = geom.faces.ravel().tolist()
            yield TriangleListPrimitive(pose=_pose(geom), points=points, indices=indices, color=color)
        case kind:
            raise ValueError(f"cannot draw a geom of kind {kind!r}")


def _pose(geom: Geom, position: tuple[float, float, float] | None = None) -> Pose:
    x, y, z = position or geom.position
    w, i, j, k = geom.quaternion
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=w, x=i, y=j, z=k))
