"""Scores of recognition: open-set counts after Kehoe 2014, 4.6, and calibration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.recognition.recogniser import Recognition

__all__ = [
    "OpenSetScore",
    "calibration_error_by_chance",
    "expected_calibration_error",
    "score_open_set",
]


@dataclass(frozen=True)
class OpenSetScore:
    """Counts over queries, some of known objects, some of unknown ones.

    Parameters
    ----------
    known, unknown
        Queries of each sort.
    recognised
        Known objects accepted as themselves.
    confused, false_unknown
        Known objects accepted as others, and unknown ones accepted as any.
    """

    known: int
    unknown: int
    recognised: int
    confused: int
    false_unknown: int

    @property
    def recall(self) -> float:
        """Share of known objects that are accepted as themselves."""
        return self.recognised / self.known if self.known else float("nan")


def score_open_set(
    answers: Iterable[tuple[str | None, Recognition]], threshold: float | None = None
) -> OpenSetScore:
    """Count right and wrong answers.

    Parameters
    ----------
    answers
        The true object's IRI, None where the object is not stored; and what was answered.
    threshold
        Count the first match as accepted from this confidence on, whatever the answer says of
        ``accepted``; default: believe ``accepted``.

    Examples
    --------
    >>> score_open_set([("object:1", Recognition("null", False))]).recall
    0.0
    """
    in_store = unknown = recognised = confused = false_unknown = 0
    for truth, answer in answers:
        accepted = answer.accepted
        if threshold is not None:
            accepted = bool(answer.matches) and answer.matches[0].confidence >= threshold
        in_store += truth is not None
        unknown += truth is None
        if accepted and truth is None:
            false_unknown += 1
        elif accepted and answer.matches[0].object_iri == truth:
            recognised += 1
        elif accepted:
            confused += 1
    return OpenSetScore(in_store, unknown, recognised, confused, false_unknown)


def expected_calibration_error(
    confidence: NDArray[np.floating], is_right: NDArray[np.bool_], bins: int = 10
) -> float:
    """Return the mean gap between confidence and share of right answers, weighted by bin size.

    Parameters
    ----------
    confidence, is_right : (n,)
        Of each answer.

    Examples
    --------
    >>> expected_calibration_error(np.array([0.9, 0.9]), np.array([True, True])).__round__(2)
    0.1
    """
    if len(confidence) == 0:
        return float("nan")
    number = np.minimum((confidence * bins).astype(int), bins - 1)
    gap = 0.0
    for b in np.unique(number):
        chosen = number == b
        gap += chosen.sum() * abs(confidence[chosen].mean() - is_right[chosen].mean())
    return float(gap / len(confidence))


def calibration_error_by_chance(
    confidence: NDArray[np.floating], bins: int = 10, draws: int = 200, seed: int = 0
) -> float:
    """Return the mean :func:`expected_calibration_error` if each confidence were exactly true.

    Few answers to a bin are right more or less often than they should be by chance alone: what is
    measured on so many is not below this, however good the confidences are.

    Parameters
    ----------
    confidence : (n,)
        Of each answer.
    draws
        Of what would be right.

    Examples
    --------
    >>> sure = np.linspace(0, 1, 100)
    >>> [round(calibration_error_by_chance(some), 1) for some in (sure, sure[::4])]
    [0.1, 0.2]
    """
    rng = np.random.default_rng(seed)
    errors = [
        expected_calibration_error(confidence, rng.random(len(confidence)) < confidence, bins)
        for _ in range(draws)
    ]
    return float(np.mean(errors))
