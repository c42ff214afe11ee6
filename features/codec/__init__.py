"""Clouds and RGB-D crops on the wire (Gatto 2016, 3.2.1 and 3.2.4).

>>> import numpy as np
>>> from features.geometry import Frame, Intrinsics
>>> camera = Intrinsics.from_fov(64, 48, 1.2)
>>> frame = Frame(np.full((48, 64), 0.5, np.float32), camera)
>>> text = to_wire(encode_frame(frame))
>>> bool(np.allclose(decode(from_wire(text)).depth_m, 0.5))
True
"""

from features.codec.cloud import encode_cloud
from features.codec.frame import encode_frame
from features.codec.limits import CloudFormatError, Limits
from features.codec.octree import encode_octree
from features.codec.sniff import decode
from features.codec.types import Cloud
from features.codec.wire import from_wire, to_wire

__all__ = [
    "Cloud",
    "CloudFormatError",
    "Limits",
    "decode",
    "encode_cloud",
    "encode_frame",
    "encode_octree",
    "from_wire",
    "to_wire",
]
