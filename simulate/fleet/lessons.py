"""What the robots of a replayed fleet learned about products, as the engine learns it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.population import Population, ProductEvidence, evidence_of
from grasp.spatial.gripper import ParallelGripper
from simulate.fleet.replay import ReportedGrasp

__all__ = ["Lessons"]


class Lessons:
    """The attempts of one graph, product by product.

    Parameters
    ----------
    hand
        Of all robots.
    """

    def __init__(self, hand: ParallelGripper) -> None:
        self._hand = hand
        self._products: dict[str, ProductEvidence] = {}

    def add(self, product: Mapping[str, Any], reports: Sequence[ReportedGrasp]) -> None:
        """Add the attempts at a product that was not met before."""
        length = float(product["size"][0])
        x = np.array([product["arms"][report.arm]["x"] for report in reports], np.float64)
        held = np.array([report.held for report in reports], np.float64)
        weights = np.array([report.weight for report in reports], np.float64)
        half_finger = self._hand.finger_width / 2 / length
        name = str(product["product"])
        self._products[name] = evidence_of(
            name, product["size"], x / length, half_finger, held, weights
        )

    def prior_of(self, product: Mapping[str, Any]) -> NDArray[np.float64] | None:
        """Return what the attempts at the other products say of what hides in one, (h,)."""
        name = str(product["product"])
        others = [evidence for other, evidence in self._products.items() if other != name]
        return Population(others).prior_of(product["size"]) if others else None
