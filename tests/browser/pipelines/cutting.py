"""A service for pipelines in the browser, a cloud for it, and a pipeline of its methods."""

from __future__ import annotations

SERVICE = '''
"""A service for tests."""
import time
from typing import Annotated

import numpy as np
from annotated_types import Ge

from features.codec import decode, encode_cloud
from rtask.errors import ServiceError
from rtask.services import Call, Service, method
from rtask.wire.message import Answer
from rtask.wire.types import Array, Cloud, Pose, Unit


class Part(Answer):
    """A part of a cloud."""

    cloud: Cloud
    pose: Pose


class Parts(Answer):
    """Parts of a cloud."""

    parts: list[Part]
    height: Annotated[float, Unit("m")]


class Cut(Service):
    """Cuts clouds and weighs them."""

    name = "lab/Cut"

    @method
    def cut(self, cloud: Cloud, pieces: Annotated[int, Ge(1)] = 2) -> Parts:
        """Cut a cloud into pieces of the same size.

        Parameters
        ----------
        pieces
            How many.
        """
        points = decode(cloud).positions
        found = [Part(cloud=encode_cloud(one), pose=np.eye(4))
                 for one in np.array_split(points, pieces)]
        return Parts(parts=found, height=float(np.ptp(points[:, 2])))

    @method(output="mass")
    def weigh(
        self, cloud: Cloud, density: float, turned: Annotated[float, Unit("rad")] = 0.0
    ) -> Annotated[float, Unit("kg")]:
        """Weigh a cloud."""
        if density < 0:
            raise ServiceError("nothing weighs less than nothing")
        return len(decode(cloud).positions) * density

    @method(output="dry", effect="reads")
    def dry(self, call: Call, seconds: Annotated[float, Unit("s"), Ge(0)]) -> bool:
        """Wait until a part is dry."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            call.check_cancelled()
            time.sleep(0.02)
        return True
'''
CLOUD = b"ply\nformat ascii 1.0\nelement vertex 6\n" + b"".join(
    b"property float %s\n" % axis for axis in (b"x", b"y", b"z")
) + b"end_header\n" + b"".join(b"%d 0 1\n" % k for k in range(6))  # fmt: skip
COMPOSED = {
    "steps": [
        {"id": "cut", "call": "lab/Cut/cut", "inputs": {"cloud": {"$input": "cloud"}, "pieces": 3}},
        {
            "id": "weigh",
            "call": "lab/Cut/weigh",
            "inputs": {"cloud": {"$ref": "item.cloud"}, "density": 0.5},
            "each": {"$ref": "cut.parts"},
        },
    ]
}
