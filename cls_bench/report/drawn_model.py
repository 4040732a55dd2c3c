"""The model that a recording carries, looked at before MuJoCo is: it may come from anyone."""

import xml.etree.ElementTree as ET

from cls_bench.errors import InputError
from cls_bench.recording import Recording
from cls_bench.text import printable

MODEL_FILES = "bench.xml", "bench_as_run.xml"
"""Attachment with the drawn model; the other is its name in older recordings."""

LONGEST = 1 << 20
"""Bytes of a model that is drawn."""

MOST_PIXELS = 4096
"""Width and height of a texture."""

ELEMENTS = frozenset({
    "mujoco", "compiler", "option", "flag", "statistic", "visual", "global", "quality", "headlight", "map", "rgba",
    "scale", "default", "asset", "texture", "material", "worldbody", "body", "inertial", "joint", "freejoint",
    "geom", "frame", "site", "camera", "light", "tendon", "fixed", "spatial", "equality", "connect", "weld",
    "actuator", "general", "motor", "sensor", "contact", "exclude",
})  # fmt: skip
"""What a bench is made of. Nothing of it reads a file, loads code or takes memory but for itself."""


def model_file(recording: Recording) -> str:
    """Name of the attachment with the drawn model. InputError if there is none."""
    for name in MODEL_FILES:
        if name in recording.attachments:
            return name
    raise InputError(f"{recording.path}: carries no {MODEL_FILES[0]}; there is nothing to draw")


def model_xml(recording: Recording) -> str:
    """The model as MJCF. InputError if there is none, or if it holds what a bench has not."""
    file = model_file(recording)
    content = recording.attachments[file]

    def refused(why: str) -> InputError:
        return InputError(f"{recording.path}: its {file} is not drawn: {why}")

    if len(content) > LONGEST:
        raise refused(f"it has {len(content)} bytes, {LONGEST} at most")
    try:
        text = content.decode()
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise refused("it declares entities")
        root = ET.fromstring(text)
    except (ET.ParseError, UnicodeDecodeError, ValueError, RecursionError):
        raise refused("it is no XML") from None
    for element in root.iter():
        if element.tag not in ELEMENTS:
            raise refused(f"it has <{printable(str(element.tag), 100)}>, which a bench has not")
        for key, value in element.attrib.items():
            if "file" in key or key in ("meshdir", "texturedir", "assetdir"):
                raise refused(f"it names the file {printable(value, 100)}")
        if element.tag == "texture":
            sizes = [element.get(key, "1") for key in ("width", "height")]
            if not all(size.isdecimal() and len(size) < 6 and int(size) <= MOST_PIXELS for size in sizes):
                raise refused(f"it has a texture of {printable(' x '.join(sizes), 100)} pixels")
        if element.tag == "quality" and any(len(value) > 5 for value in element.attrib.values()):
            raise refused("its quality of drawing is beyond measure")
    return text


def camera_names(xml: str) -> list[str]:
    """Names of the cameras in a model."""
    return [element.get("name", "") for element in ET.fromstring(xml).iter("camera")]


def check_time(recording: Recording, at: float) -> None:
    """Raise InputError unless ``at`` [s] lies in the recording."""
    if not 0.0 <= at <= recording.duration:
        raise InputError(f"{recording.path}: ends at {recording.duration:g} s; there is nothing at {at:g} s")
