"""Quality of grasps of a curved part as its curves are drawn by more and more vertices."""

from __future__ import annotations

import numpy as np

from grasp.push import PushTest, Tolerance, analyse, as_part, sample_grasps
from tests.grasp.push.outlines import ellipse, pebble, plate, stadium

_SAMPLES = 1000
_SHAPES = {
    "circle": (lambda count: ellipse(count, 1.0), 24),
    "ellipse": (ellipse, 24),
    "stadium": (stadium, 12),
    "plate": (plate, 5),
    "pebble": (pebble, 32),
}


def curves() -> None:
    """Q* of the same grasps at one, two, four and eight times the vertices, two tolerances."""
    print("part      vertex std  curves        Q* at 1, 2, 4, 8 times the vertices   largest step")
    for name, (outline, count) in _SHAPES.items():
        counts = [count, 2 * count, 4 * count, 8 * count]
        base = as_part(outline(2 * count))
        grasps = sample_grasps(base, angles=5)
        for std in (0.045, 0.015):
            for rolling in (False, True):
                test = PushTest(0.25 * base.diameter, rolling=rolling)
                tolerance = Tolerance(
                    std * base.radius, 0.03 * base.radius, correlation=0.5 * base.radius
                )
                best = [
                    float(
                        analyse(
                            as_part(outline(n)), grasps, test, tolerance, samples=_SAMPLES
                        ).quality.max()
                    )
                    for n in counts
                ]
                step = float(np.abs(np.diff(best)).max())
                values = "  ".join(f"{q:.3f}" for q in best)
                way = "smooth" if rolling else "flat facets"
                print(f"{name:8s}  {std:10.3f}  {way:12s}  {values:34s}  {step:12.3f}")


__all__ = ["curves"]
