"""Confidence of a pose (s_T of Kehoe 2014, 4.4) and its acceptance threshold (c_T)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["PoseConfidence"]


@dataclass(frozen=True)
class PoseConfidence:
    """Constants of the confidence: a logistic function of fit and contradiction, then scaled down.

    Parameters
    ----------
    fit, violation, offset
        Weights of the logistic function.
    threshold
        Kehoe's c_T: the least confidence of an accepted pose.
    min_explained
        Share of the segment that lies on the model, below which the confidence is scaled down.
    max_from_view
        The most confidence of a pose that rests on one stored view.
    """

    fit: float = 5.26
    violation: float = -15.9
    offset: float = 0.08
    threshold: float = 0.7
    min_explained: float = 0.6
    max_from_view: float = 0.8

    def of(self, fit: float, violation: float, explained: float = 1.0, rivals: int = 0) -> float:
        """Return the confidence of a pose.

        Parameters
        ----------
        fit, violation
            Of the pose, 0..1.
        explained
            Share of the segment's points on the model.
        rivals
            Other poses that are as good.

        Examples
        --------
        >>> sure, torn = PoseConfidence().of(0.9, 0.0), PoseConfidence().of(0.9, 0.0, rivals=1)
        >>> sure > 0.9, torn < 0.5
        (True, True)
        """
        score = self.fit * fit + self.violation * violation + self.offset
        sure = float(1 / (1 + np.exp(-np.clip(score, -60, 60))))
        if explained < self.min_explained:
            sure *= explained
        return sure / (1 + rivals)
