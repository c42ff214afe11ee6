"""Clouds of ROS 2 as requests carry them, and points of answers as clouds."""

from __future__ import annotations

import array
import base64
from typing import Any

import numpy as np

from rtask.interop.ros.convert import JsonObject, Make, mapping_of

__all__ = ["cloud_json", "cloud_of_rows"]

_FLOAT32 = 7
_ROW_BYTES = 16
_FOUR_BYTES = (5, 6, _FLOAT32)
"""INT32, UINT32 and FLOAT32, in which drivers pack colours."""


def cloud_json(cloud: Any) -> JsonObject:
    """Return a PointCloud2 as JSON with nothing but x, y, z and colour, if it has more.

    Drivers pad points to 32 bytes; the link to the server carries 16 then.
    """
    columns = _columns(cloud)
    is_plain = (
        columns is not None
        and cloud.point_step > _ROW_BYTES
        and not cloud.is_bigendian
        and cloud.row_step == cloud.point_step * cloud.width
        and len(cloud.data) == cloud.row_step * cloud.height
    )
    if columns is None or not is_plain:
        message: JsonObject = mapping_of(cloud)
        return message
    rows = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_step)
    table = np.hstack([rows[:, int(f.offset) : int(f.offset) + 4] for f in columns])
    return {
        "header": mapping_of(cloud.header),
        "height": cloud.height,
        "width": cloud.width,
        "fields": [
            {"name": field.name, "offset": 4 * k, "datatype": field.datatype, "count": 1}
            for k, field in enumerate(columns)
        ],
        "is_bigendian": False,
        "point_step": _ROW_BYTES,
        "row_step": _ROW_BYTES * cloud.width,
        "data": base64.b64encode(table.tobytes()).decode("ascii"),
        "is_dense": cloud.is_dense,
    }


def _columns(cloud: Any) -> list[Any] | None:
    """Return the fields x, y, z and colour; None if some are missing or of another kind."""
    fields = {field.name: field for field in cloud.fields}
    colour = fields.get("rgb", fields.get("rgba"))
    columns = [*(fields.get(axis) for axis in "xyz"), colour]
    for field, kinds in zip(columns, (*3 * ((_FLOAT32,),), _FOUR_BYTES), strict=True):
        if field is None or field.count > 1 or field.datatype not in kinds:
            return None
        if field.offset + 4 > cloud.point_step:
            return None
    return columns


def cloud_of_rows(rows: bytes, header: Any, make: Make) -> Any:
    """Return a PointCloud2 of points of 16 bytes: x, y, z and rgb."""
    cloud = make("sensor_msgs/PointCloud2")
    cloud.header = header
    cloud.height, cloud.width = 1, len(rows) // _ROW_BYTES
    cloud.fields = [make("sensor_msgs/PointField") for _ in range(4)]
    for k, (field, name) in enumerate(zip(cloud.fields, ("x", "y", "z", "rgb"), strict=True)):
        field.name, field.offset, field.datatype, field.count = name, 4 * k, _FLOAT32, 1
    cloud.point_step, cloud.row_step = _ROW_BYTES, len(rows)
    cloud.data = array.array("B", rows)
    points = np.frombuffer(rows, "<f4").reshape(-1, 4)[:, :3]
    cloud.is_dense = bool(np.isfinite(points).all())
    return cloud
