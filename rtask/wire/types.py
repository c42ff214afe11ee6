"""Types of the fields of messages: numbers, texts, bytes, poses, points.

Each type says three things: how a value is read, what JSON Schema publishes for it, and which ROS
type it has. The schema shows the canonical form alone; numbers may also come as numeric text and
flags as ``"true"``, as in the printed messages of Gatto 2016, 3.2.4. A unit belongs to the type:
``Annotated[Number, Unit("m"), Ge(0)]``.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, PlainSerializer, PlainValidator
from pydantic_core import PydanticCustomError, core_schema

from rtask.wire.fields import Kind

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler

__all__ = [
    "Array",
    "ArrayOf",
    "Box",
    "Bytes",
    "Carried",
    "Cloud",
    "Flag",
    "Grasp",
    "GraspPose",
    "GripperTranslation",
    "Image",
    "Iri",
    "JointTrajectory",
    "Json",
    "Mask",
    "Number",
    "Points",
    "Pose",
    "PoseStamped",
    "Probability",
    "Stamp",
    "Text",
    "Texts",
    "Unit",
    "Whole",
    "carried",
]

MAX_POINTS = 500
_SPACE = re.compile(r"\s+")
_STANDARD_ALPHABET = str.maketrans("-_", "+/")
_FLAGS = {"true": True, "false": False, "1": True, "0": False}

Schema = dict[str, Any]


@dataclass(frozen=True)
class Carried:
    """The form in which a value is sent.

    Parameters
    ----------
    ros
        ROS type; of one element, where the value is an array.
    python
        Type that a program may pass to the client.
    schema
        JSON Schema; None = the one of the Python type.
    is_list
        Whether ROS carries an array.
    is_packed
        Whether the text is base64 of bytes.
    also
        Other ROS types in which a value may come, each by the ending of a field's name.
    """

    ros: str
    python: str
    schema: Mapping[str, Any] | None = field(default=None, hash=False)
    is_list: bool = False
    is_packed: bool = False
    also: tuple[tuple[str, str], ...] = ()

    def __get_pydantic_json_schema__(
        self, core: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> Schema:
        return handler(core) if self.schema is None else dict(self.schema)


def carried(kind: Kind) -> Carried | None:
    """Return the form in which the values of a field are sent, if its type declares one."""
    return next((marker for marker in kind.metadata if isinstance(marker, Carried)), None)


@dataclass(frozen=True)
class Unit:
    """Unit of a number, as its symbol: ``m``, ``rad``, ``kg``."""

    symbol: str

    def __get_pydantic_json_schema__(
        self, core: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> Schema:
        return {**handler(core), "x-unit": self.symbol}


_LAST_S = 253_402_300_799.0
"""End of the year 9999, beyond which there is no calendar date."""


def expected(what: str) -> PydanticCustomError:
    """Return the error that says what was expected in place of what came."""
    return PydanticCustomError("expected", "{what}", {"what": what})


def refused(words: object) -> PydanticCustomError:
    """Return an error in words of our own."""
    return PydanticCustomError("refused", "{words}", {"words": str(words)})


def _number(value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise expected("a finite number")
    return number


def _whole(value: Any) -> int:
    if type(value) is int:
        return value
    number = _number(value)
    if number != int(number):
        raise expected("a whole number")
    # Through a float, a long numeral would lose its last digits.
    return int(value) if isinstance(value, str) and value.isdecimal() else int(number)


def _flag(value: Any) -> bool:
    if isinstance(value, bool):
        return value
    flag = _FLAGS.get(str(value).strip().casefold()) if isinstance(value, str | int) else None
    if flag is None:
        raise expected("true or false")
    return flag


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.strip():
        raise expected("a text")
    return value


def _texts(value: Any) -> list[str]:
    listed = [value] if isinstance(value, str) else value
    if not isinstance(listed, list | tuple) or not all(isinstance(text, str) for text in listed):
        raise expected("a list of texts")
    return list(listed)


def _bytes(value: Any) -> bytes:
    """Return bytes, or those of base64 text in either alphabet, with or without padding."""
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    if not isinstance(value, str):
        raise expected("base64 text")
    try:
        return binascii.a2b_base64(value, strict_mode=True)
    except (binascii.Error, ValueError):
        packed = _SPACE.sub("", value).translate(_STANDARD_ALPHABET).rstrip("=")
    try:
        return base64.b64decode(packed + "=" * (-len(packed) % 4), validate=True)
    except (binascii.Error, ValueError) as error:
        raise refused(f"not base64: {error}; it begins with {value[:12]!r}") from None


def _base64(value: bytes) -> str:
    return base64.b64encode(value).decode("ascii")


def _cloud(value: Any) -> bytes:
    """Return bytes as :func:`_bytes` does, of a ``sensor_msgs/PointCloud2`` a PCD file."""
    if not isinstance(value, Mapping):
        return _bytes(value)
    from features.codec.ros import image_bytes, is_image, is_point_cloud, pcd_from_point_cloud

    try:
        if is_image(value):
            return image_bytes(value)
        if is_point_cloud(value):
            return pcd_from_point_cloud(value)
    except ValueError as error:
        raise refused(error) from error
    raise expected("base64 text or a sensor_msgs/PointCloud2")


def _image(value: Any) -> bytes:
    """Return bytes as :func:`_bytes` does, or those of a message that carries an image."""
    if not isinstance(value, Mapping):
        return _bytes(value)
    from features.codec.ros import image_bytes, is_image

    if not is_image(value):
        raise expected("base64 text or a sensor_msgs/CompressedImage")
    try:
        return image_bytes(value)
    except ValueError as error:
        raise refused(error) from error


def _mask(value: Any) -> bytes:
    """Return bytes as :func:`_image` does, of any other object its JSON."""
    if isinstance(value, Mapping):
        from features.codec.ros import is_image

        if not is_image(value):
            return json.dumps(value).encode()
    return _image(value)


def _pose(value: Any) -> NDArray[np.float64]:
    from grasp.messages import matrix_from_message

    if isinstance(value, np.ndarray) and value.shape == (4, 4):
        return value
    try:
        return np.asarray(matrix_from_message(value), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise refused(error) from error


def _pose_message(pose: NDArray[np.float64]) -> dict[str, Any]:
    from grasp.messages import pose_message

    return pose_message(pose)


def _stamp(value: Any) -> float | None:
    """Return s since the epoch of a number, or of a stamp of ROS 1 or ROS 2, None if not set."""
    if not isinstance(value, dict):
        return _within_dates(_number(value))
    if not value.keys() & {"sec", "secs"}:
        raise expected("s since 1970, or {sec, nanosec}")
    whole = _number(value.get("sec", value.get("secs")))
    time_s = whole + _number(value.get("nanosec", value.get("nsecs", 0))) * 1e-9
    # A header that nobody filled in has the time 0, and not 1970 (std_msgs/Header).
    return _within_dates(time_s) if time_s else None


def _within_dates(time_s: float) -> float:
    if 0.0 <= time_s <= _LAST_S:
        return time_s
    raise expected("s since 1970, neither ms nor ns")


def _grasp(value: Any) -> str | dict[str, Any]:
    """Take a grasp as it was received, whatever the robot added to it."""
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, BaseModel):  # of an answer in the same process
        value = value.model_dump(by_alias=True, exclude_unset=True)
    if not isinstance(value, dict):
        raise expected("the id of a grasp, or a grasp as received")
    return value


@dataclass(frozen=True)
class ArrayOf:
    """Rows of numbers, read as a float64 array.

    Parameters
    ----------
    columns
        Length of a row; None = one row of any length.
    unit
        Of all numbers.
    max_rows
        Largest number of rows.
    form
        The form in words, for errors: ``[x, y, z]``.
    """

    columns: int | None = None
    unit: str = ""
    max_rows: int | None = None
    form: str = ""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(np.ndarray.tolist)
        return core_schema.no_info_plain_validator_function(self._read, serialization=written)

    def __get_pydantic_json_schema__(
        self, core: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> Schema:
        items: Schema = {"type": "number"}
        if self.columns is not None:
            length = {"minItems": self.columns, "maxItems": self.columns}
            items = {"type": "array", "items": items, **length}
        schema: Schema = {"type": "array", "items": items}
        if self.max_rows is not None:
            schema["maxItems"] = self.max_rows
        return {**schema, "x-unit": self.unit} if self.unit else schema

    def _read(self, value: Any) -> NDArray[np.float64]:
        shape = (-1,) if self.columns is None else (-1, self.columns)
        try:
            array = np.array(value, dtype=np.float64).reshape(shape)
        except (TypeError, ValueError, OverflowError) as error:
            form = f"a list of {self.form or 'numbers'}" + (f" in {self.unit}" * bool(self.unit))
            raise expected(form) from error
        if not np.isfinite(array).all():
            raise refused("points must be finite" if self.form else "numbers must be finite")
        if self.max_rows is not None and len(array) > self.max_rows:
            raise refused(f"{len(array)} points; at most {self.max_rows}")
        return array


_BASE64: Schema = {"type": "string", "contentEncoding": "base64"}
_XYZ: Schema = {
    "type": "object",
    "properties": {axis: {"type": "number"} for axis in "xyz"},
    "required": list("xyz"),
}
_POSE: Schema = {
    "type": "object",
    "properties": {
        "position": _XYZ,
        "orientation": {
            "type": "object",
            "properties": {axis: {"type": "number"} for axis in "xyzw"},
            "required": list("xyzw"),
        },
    },
    "required": ["position", "orientation"],
}

Number = Annotated[float, BeforeValidator(_number)]
"""A finite number."""
Whole = Annotated[int, BeforeValidator(_whole)]
"""A whole number."""
Flag = Annotated[bool, BeforeValidator(_flag)]
"""True or false."""
Probability = Annotated[Number, Ge(0.0), Le(1.0)]
"""A number from 0 to 1."""
Text = Annotated[
    str, BeforeValidator(_text), Carried("string", "str", {"type": "string", "pattern": r"\S"})
]
"""A text that is not blank."""
Iri = Annotated[
    str, BeforeValidator(_text), Carried("string", "str", {"type": "string", "format": "iri"})
]
"""An IRI."""
Texts = Annotated[
    list[str], BeforeValidator(_texts), Carried("string", "Sequence[str]", None, True)
]
"""A list of texts; a single text is a list of one."""
Bytes = Annotated[
    bytes,
    PlainValidator(_bytes),
    PlainSerializer(_base64),
    Carried("string", "Bytes", _BASE64, is_packed=True),
]
"""Bytes, base64 in JSON."""
Cloud = Annotated[
    bytes,
    PlainValidator(_cloud),
    PlainSerializer(_base64),
    Carried(
        "string",
        "Bytes | Mapping[str, Any]",
        {**_BASE64, "contentMediaType": "application/vnd.rtask.cloud"},
        is_packed=True,
        also=(("cloud", "sensor_msgs/PointCloud2"),),
    ),
]
"""A point cloud or depth image, as :mod:`features.codec` packs it, or a sensor_msgs/PointCloud2."""
Image = Annotated[
    bytes,
    PlainValidator(_image),
    PlainSerializer(_base64),
    Carried(
        "string",
        "Bytes | Mapping[str, Any]",
        {**_BASE64, "contentMediaType": "image/*"},
        is_packed=True,
        also=(("message", "sensor_msgs/CompressedImage"),),
    ),
]
"""A picture, PNG or JPEG, or a sensor_msgs/CompressedImage or Image that carries one."""
Mask = Annotated[
    bytes,
    PlainValidator(_mask),
    PlainSerializer(_base64),
    Carried(
        "string",
        "Bytes | Mapping[str, Any]",
        {"anyOf": [{**_BASE64, "contentMediaType": "image/png"}, {"type": "object"}]},
        is_packed=True,
    ),
]
"""Labels of the pixels of an image as PNG, or a mask as a COCO run-length encoding in JSON."""
Box = Annotated[
    NDArray[np.float64],
    ArrayOf(unit="px"),
    Carried("float64", "Sequence[float]", None, True),
]
"""Left, top, width and height of a box in an image, px."""
Pose = Annotated[
    NDArray[np.float64],
    PlainValidator(_pose),
    PlainSerializer(_pose_message),
    Carried("geometry_msgs/Pose", "Mapping[str, Any]", _POSE),
]
"""A geometry_msgs/Pose, read as a transform (4, 4); m and a unit quaternion."""
Stamp = Annotated[
    float,
    PlainValidator(_stamp),
    Carried("time", "float | Mapping[str, int]", {"type": "number"}),
    Unit("s"),
]
"""A time, s since the epoch; a stamp of ROS 1 or ROS 2 is read as well, as absent if it is 0."""
_GRASP: Schema = {"anyOf": [{"type": "string"}, {"type": "object"}]}

Grasp = Annotated[
    str | dict[str, Any],
    PlainValidator(_grasp),
    Carried("string", "str | Mapping[str, Any]", _GRASP, also=(("message", "moveit_msgs/Grasp"),)),
]
"""The id of a grasp, or a grasp as it was received."""
GraspPose = Annotated[
    str | dict[str, Any],
    PlainValidator(_grasp),
    Carried("geometry_msgs/PoseStamped", "str | Mapping[str, Any]", _GRASP),
]
"""A geometry_msgs/PoseStamped of a gripper."""
JointTrajectory = Annotated[
    dict[str, Any], Carried("trajectory_msgs/JointTrajectory", "dict[str, Any]")
]
"""A trajectory_msgs/JointTrajectory."""
PoseStamped = Annotated[dict[str, Any], Carried("geometry_msgs/PoseStamped", "dict[str, Any]")]
"""A geometry_msgs/PoseStamped."""
GripperTranslation = Annotated[
    dict[str, Any], Carried("moveit_msgs/GripperTranslation", "dict[str, Any]")
]
"""A moveit_msgs/GripperTranslation."""
Array = Annotated[NDArray[np.float64], ArrayOf(), Carried("float64", "Sequence[float]", None, True)]
"""A list of numbers, read as an array (n,)."""
Points = Annotated[
    NDArray[np.float64],
    ArrayOf(3, "m", MAX_POINTS, "[x, y, z]"),
    Carried("geometry_msgs/Point", "Sequence[Sequence[float]]", None, True),
]
"""At most 500 points, read as an array (n, 3), m."""
Json = dict[str, Any]
"""An object of JSON whose members are not declared."""
