"""A quality that learns from outcomes: Bayesian logistic regression, one example at a time.

The belief about the weights is a Gaussian; each outcome moves it to the Laplace approximation of
its posterior (Spiegelhalter and Lauritzen 1990). There is no training phase. The quality by
geometry stays in charge until the model has predicted the last outcomes better, each judged before
it was learned (Dawid 1984).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp.arrays import FloatArray
from grasp.learning.agents.tabular import load_arrays, save_arrays

__all__ = ["LearnedQuality", "LogisticRegression"]


_NEWTON_STEPS = 30
_SURE = 1e-3


class LogisticRegression:
    """P(success) = logistic(w . (1, x)) with a Gaussian belief about w.

    Parameters
    ----------
    size
        Number of features, not counting the constant.
    prior_std
        Of each weight before the first outcome; features should be of order one.

    Examples
    --------
    >>> model = LogisticRegression(1)
    >>> for _ in range(20):
    ...     model.learn([1.0], True)
    ...     model.learn([-1.0], False)
    >>> [round(float(p), 1) for p in model.predict([[2.0], [0.0], [-2.0]])]
    [1.0, 0.5, 0.0]
    """

    def __init__(self, size: int, prior_std: float = 2.0) -> None:
        if size < 1 or not prior_std > 0:
            raise ValueError(f"{size} features with prior_std {prior_std} make no model")
        self.size, self.prior_std = size, prior_std
        self.mean = np.zeros(size + 1)
        self.covariance = prior_std**2 * np.eye(size + 1)

    def _rows(self, features: ArrayLike) -> FloatArray:
        rows = np.atleast_2d(np.asarray(features, dtype=np.float64))
        if rows.shape[1] != self.size or not np.all(np.isfinite(rows)):
            raise ValueError(f"expected {self.size} finite features, got {rows.tolist()}")
        return np.column_stack([np.ones(len(rows)), rows])

    def predict(self, features: ArrayLike) -> FloatArray:
        """Return the chance of success for features (n, size), (n,); the weights' doubt included.

        The mean of the logistic function under the belief, after MacKay 1992.
        """
        rows = self._rows(features)
        variance = np.einsum("ni,ij,nj->n", rows, self.covariance, rows)
        return _logistic(rows @ self.mean / np.sqrt(1 + np.pi * variance / 8))

    def learn(self, features: ArrayLike, success: bool) -> None:
        """Move the belief by one outcome with features (size,)."""
        x = self._rows(features)[0]
        along = self.covariance @ x
        spread, start = float(x @ along), float(x @ self.mean)
        # The posterior's mode lies on the line mean + t * along, where t = y - logistic(w . x).
        low, high = (0.0, 1.0) if success else (-1.0, 0.0)
        t = 0.0
        for _ in range(_NEWTON_STEPS):
            p = float(_logistic(np.array(start + t * spread)))
            residual = float(success) - p - t
            low, high = (t, high) if residual > 0 else (low, t)
            t += residual / (1 + p * (1 - p) * spread)
            if not low < t < high:
                t = (low + high) / 2
        p = float(_logistic(np.array(start + t * spread)))
        self.mean = self.mean + t * along
        curvature = p * (1 - p)
        self.covariance = self.covariance - np.outer(along, along) * (
            curvature / (1 + curvature * spread)
        )


def _logistic(x: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (1 + np.tanh(x / 2)))


class LearnedQuality:
    """The quality by geometry, replaced by the model's prediction once that is better.

    Parameters
    ----------
    size, prior_std
        As of :class:`LogisticRegression`. The quality itself is a feature more: its logit.
    window
        Over how many of the last outcomes the log losses are compared; before so many are known
        geometry stays in charge.
    """

    def __init__(self, size: int, prior_std: float = 2.0, window: int = 100) -> None:
        if window < 1:
            raise ValueError(f"a window of {window} outcomes compares nothing")
        self.window = window
        self.model = LogisticRegression(size + 1, prior_std)
        self._losses: deque[tuple[float, float]] = deque(maxlen=window)

    @property
    def losses(self) -> tuple[float, float]:
        """Mean log loss of quality and model over the window, nat; NaN before the first outcome."""
        if not self._losses:
            return float("nan"), float("nan")
        quality, model = np.mean(np.array(self._losses), axis=0)
        return float(quality), float(model)

    @property
    def in_charge(self) -> bool:
        """Whether the model has taken over."""
        quality, model = self.losses
        return len(self._losses) == self.window and model < quality

    def rate(self, features: ArrayLike, quality: ArrayLike) -> FloatArray:
        """Return the quality (n,) to believe in, for features (n, size) and quality (n,)."""
        q = _checked(quality)
        return self.model.predict(_with_quality(features, q)) if self.in_charge else q

    def learn(self, features: ArrayLike, quality: float, success: bool) -> None:
        """Judge both on one outcome, then learn it."""
        q = _checked([quality])
        row = _with_quality(np.atleast_2d(np.asarray(features, dtype=np.float64)), q)
        predicted = self.model.predict(row)
        self._losses.append((_loss(q[0], success), _loss(predicted[0], success)))
        self.model.learn(row[0], success)

    def save(self, path: Path) -> None:
        """Write everything that is needed to go on exactly here."""
        arrays: dict[str, NDArray[Any]] = {
            "mean": self.model.mean,
            "covariance": self.model.covariance,
            "losses": np.array(self._losses, dtype=np.float64).reshape(-1, 2),
        }
        save_arrays(path, "LearnedQuality", np.random.default_rng(0), self._parameters(), arrays)

    def load(self, path: Path) -> None:
        """Go on where :meth:`save` stopped.

        Raises
        ------
        ValueError
            Another file, version, or number of features; says what to do.
        """
        unused = np.random.default_rng(0)
        arrays = load_arrays(path, "LearnedQuality", unused, self._parameters())
        self.model.mean, self.model.covariance = arrays["mean"], arrays["covariance"]
        self._losses = deque(
            ((float(q), float(m)) for q, m in arrays["losses"]), maxlen=self.window
        )

    def _parameters(self) -> Mapping[str, Any]:
        model = self.model
        return {"size": model.size, "prior_std": model.prior_std, "window": self.window}


def _checked(quality: ArrayLike) -> FloatArray:
    q = np.asarray(quality, dtype=np.float64)
    wrong = ~((q >= 0) & (q <= 1))
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise ValueError(f"quality of candidate {k} must lie in 0..1, got {q[k]}")
    return q


def _with_quality(features: ArrayLike, quality: FloatArray) -> FloatArray:
    sure = np.clip(quality, _SURE, 1 - _SURE)
    rows = np.asarray(features, dtype=np.float64)
    return np.column_stack([rows, np.log(sure / (1 - sure)) / 3])


def _loss(chance: float, success: bool) -> float:
    sure = float(np.clip(chance, _SURE, 1 - _SURE))
    return -float(np.log(sure if success else 1 - sure))
