"""What the topics of a recording carry, and which colour belongs to which depth.

Told from names, encodings and frames before anything is joined: two cameras of one robot must not
lend each other their pictures, and confidence or disparity is neither depth nor colour.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from features.codec.ros import DEPTH_ENCODINGS

__all__ = [
    "Plan",
    "Topic",
    "is_infrared_topic",
    "is_rectified_topic",
    "plan_topics",
    "says_depth",
    "sensor_of",
]

_INFRARED = re.compile(r"(^|[/_])(ir|infra\d*|infrared\d*|infrared_\d+|thermal|lwir)([/_]|$)", re.I)
_SIDE = re.compile(
    r"(^|[/_])(confidence|disparity|mask|labels?|segmentation|amplitude|intensity)([/_]|$)", re.I
)
_COLOURED = re.compile(r"(^|[/_])(rgb|colou?r)([/_\d]|$)", re.I)
_RECTIFIED = re.compile(r"(^|/)image_rect|(^|[/_])rect(ified)?(/|$)", re.I)
_OF_DEPTH = re.compile(r"(^|/)depth(_\d+|_image)?(?=/|$)", re.I)
_ALIGNED = re.compile(r"aligned_depth|depth_registered|depth_to_(rgb|colou?r)", re.I)
_GREY_ENCODINGS = ("mono8", "8UC1")


@dataclass(frozen=True)
class Topic:
    """A topic with pictures or clouds.

    Parameters
    ----------
    name
    kind
        Type of its messages, such as ``sensor_msgs/msg/Image``.
    encoding
        Of its first message: ``encoding`` of an Image, ``format`` of a CompressedImage.
    frame_id
        Of its first message.
    """

    name: str
    kind: str
    encoding: str = ""
    frame_id: str = ""

    @property
    def frame(self) -> str:
        """The frame without the slash that ROS 1 once wrote before it."""
        return self.frame_id.lstrip("/")

    @property
    def is_aligned(self) -> bool:
        """Whether its depth was laid over colour before it was published."""
        return _ALIGNED.search(self.name) is not None

    @property
    def root(self) -> str:
        """The name space of its camera: what stands before the part that says depth."""
        device = sensor_of(self.name).rpartition("/")[0]
        if device:
            return device
        parts = self.name.split("/")
        at = next((k for k, part in enumerate(parts) if says_depth(part)), len(parts) - 1)
        return "/".join(parts[:at])


@dataclass
class Plan:
    """The part of each topic in the views of a recording.

    Parameters
    ----------
    has_clouds
        Whether there are topics of clouds.
    depth
        Topics of depth by name.
    colour
        Topics of colour by name.
    partners
        Of each topic of depth, the topics of colour of its camera.
    left_out
        Why topics are not used, by name.
    doubts
        What is taken for granted, by name.
    """

    has_clouds: bool = False
    depth: dict[str, Topic] = field(default_factory=dict)
    colour: dict[str, Topic] = field(default_factory=dict)
    partners: dict[str, tuple[str, ...]] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    doubts: dict[str, str] = field(default_factory=dict)


def plan_topics(topics: Sequence[Topic]) -> Plan:
    """Return what each topic with pictures is for.

    Examples
    --------
    >>> image = "sensor_msgs/msg/Image"
    >>> plan = plan_topics([Topic("/head/depth/image_raw", image, "16UC1"),
    ...                     Topic("/head/color/image_raw", image, "rgb8"),
    ...                     Topic("/wrist/color/image_raw", image, "rgb8")])
    >>> plan.partners
    {'/head/depth/image_raw': ('/head/color/image_raw',)}
    """
    plan = Plan(any(topic.kind.endswith("PointCloud2") for topic in topics))
    pictures = [topic for topic in topics if topic.kind.endswith("Image")]
    # An image of 16 bits is depth only where nothing else could be: beside a cloud or named depth
    # it may as well be an infrared picture or a mask.
    has_space = plan.has_clouds or any(
        says_depth(topic.name) and not _is_colour_beside_depth(topic) for topic in pictures
    )
    for topic in pictures:
        _give_part(plan, topic, has_space)
    # Collected first, since what is deleted here is what the others are compared with.
    for name in [name for name, topic in plan.depth.items() if _is_superseded(plan, topic)]:
        del plan.depth[name]
    for name, topic in plan.depth.items():
        plan.partners[name] = _partners(topic, list(plan.colour.values()))
    used = {name for names in plan.partners.values() for name in names}
    for name, topic in plan.colour.items():
        if plan.depth and name not in used and not any(
            _is_of_camera(topic, depth) for depth in plan.depth.values()
        ):  # fmt: skip
            # A colour that no depth took as the best of its camera is no fault; one of no camera
            # with depth is left out, and that is said.
            plan.left_out[name] = f"of another camera than the depth of {', '.join(plan.depth)}"
    return plan


def _give_part(plan: Plan, topic: Topic, has_space: bool) -> None:
    says, encoding = says_depth(topic.name), topic.encoding
    is_depth = encoding.startswith(DEPTH_ENCODINGS) or "compresseddepth" in encoding.lower()
    is_small = topic.kind.endswith("CompressedImage") and not encoding.startswith("mono16")
    if is_infrared_topic(topic.name):
        plan.left_out[topic.name] = "infrared, which is neither depth nor colour"
    elif _SIDE.search(topic.name):
        plan.left_out[topic.name] = "by its name neither depth nor colour"
    elif says and (is_depth or encoding == "mono16" or (is_small and "jp" not in encoding.lower())):
        plan.depth[topic.name] = topic
    elif not is_depth and encoding != "mono16" and _draws_depth(topic.name):
        plan.left_out[topic.name] = (
            f"{encoding} has 8 bits, which is a drawing of depth"
            if "8" in encoding or not topic.kind.endswith("/Image")
            else f"{encoding} is not read as depth, only {', '.join(DEPTH_ENCODINGS)}"
        )
    elif (is_depth and has_space and not says) or encoding.startswith("mono16"):
        plan.left_out[topic.name] = f"{encoding} on a topic that does not say that it carries depth"
    elif is_depth:
        plan.depth[topic.name] = topic
        plan.doubts[topic.name] = (
            f"taken for depth, since it is {encoding}; its name does not say so"
        )
    else:
        plan.colour[topic.name] = topic


def _is_superseded(plan: Plan, depth: Topic) -> bool:
    """Whether the same camera's depth is there laid over colour as well."""
    return not depth.is_aligned and any(
        other.is_aligned and other.root == depth.root for other in plan.depth.values()
    )


def _draws_depth(name: str) -> bool:
    """Whether a picture of 8 bits shows depth: nothing in its name stands for colour after depth.

    Examples
    --------
    >>> [_draws_depth(f"/{name}/image_raw") for name in ("camera/depth", "depth_camera/rgb")]
    [True, False]
    """
    ends = [match.end() for match in (*_OF_DEPTH.finditer(name), *_ALIGNED.finditer(name))]
    if not ends:
        return says_depth(_image_name(name))
    aligned = _ALIGNED.search(name)
    rest = name[max(ends) :] if aligned is None else name[aligned.end() :].partition("/")[2]
    return _COLOURED.search(rest) is None


def _image_name(topic: str) -> str:
    """Return the last part of a topic that is no transport.

    >>> _image_name("/camera/depth_vis/compressed")
    'depth_vis'
    """
    parts = topic.strip("/").split("/")
    return parts[-2] if parts[-1].startswith("compressed") and len(parts) > 1 else parts[-1]


def _is_colour_beside_depth(topic: Topic) -> bool:
    """Whether a topic is colour in a name space that says depth: /depth_camera/rgb/image_raw."""
    return _COLOURED.search(topic.name) is not None and not topic.encoding.startswith(
        ("mono16", *DEPTH_ENCODINGS)
    )


def _is_of_camera(colour: Topic, depth: Topic) -> bool:
    has_its_frame = bool(depth.frame) and colour.frame == depth.frame
    return has_its_frame or colour.name.startswith(depth.root + "/")


def _partners(depth: Topic, colours: list[Topic]) -> tuple[str, ...]:
    """Return the topics with the best colour of the camera of depth: in full colour, its frame."""
    ranked = sorted(
        (_rank(colour, depth), colour.name) for colour in colours if _is_of_camera(colour, depth)
    )
    return tuple(name for rank, name in ranked if rank == ranked[0][0])


def _rank(colour: Topic, depth: Topic) -> tuple[bool, bool, bool, int]:
    shared = 0
    for mine, other in zip(colour.name.split("/"), depth.name.split("/"), strict=False):
        if mine != other:
            break
        shared += 1
    is_grey = colour.encoding.startswith(_GREY_ENCODINGS)
    return is_grey, says_depth(colour.name), colour.frame != depth.frame, -shared


def says_depth(topic: str) -> bool:
    """Whether the name of a topic says depth."""
    return "depth" in topic.lower()


def is_infrared_topic(topic: str) -> bool:
    """Whether the name of a topic says that its images are infrared or thermal.

    Where it says depth as well, the word that comes last counts.

    Examples
    --------
    >>> is_infrared_topic("/camera/infra1/image_rect_raw"), is_infrared_topic("/camera/first/image")
    (True, False)
    >>> is_infrared_topic("/camera/depth/ir_image"), is_infrared_topic("/camera/ir/depth_image")
    (True, False)
    """
    # Of two such words in a name the later one is about the image, the earlier one about the
    # device.
    last = max((match.start() for match in _INFRARED.finditer(topic)), default=-1)
    return last >= 0 and last >= topic.lower().rfind("depth")


def is_rectified_topic(topic: str) -> bool:
    """Whether images of a topic were rectified before they were published (``image_proc``).

    Examples
    --------
    >>> names = ("rgb/image_rect_color/compressed", "depth_rectified/image", "rectangles/image")
    >>> [is_rectified_topic(name) for name in names]
    [True, True, False]
    """
    return _RECTIFIED.search(topic) is not None


def sensor_of(topic: str) -> str:
    """Return the sensor of a topic of RealSense's own recordings; empty for other topics.

    Examples
    --------
    >>> sensor_of("/device_0/sensor_0/option/Depth_Units/value")
    '/device_0/sensor_0'
    """
    parts = topic.split("/")
    is_sensor = len(parts) > 3 and parts[1].startswith("device_") and parts[2].startswith("sensor_")
    return "/".join(parts[:3]) if is_sensor else ""
