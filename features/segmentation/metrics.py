"""Agreement of a label map with the ground truth.

Overlap after the best one-to-one match of segments (Gatto 2016, 5.1 reports precision and recall
of segments); 0 = no object in both maps. Only pixels whose true label is known count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["SegmentationScore", "score_labels"]

_GOOD_MATCH = 0.75


@dataclass(frozen=True)
class SegmentationScore:
    """Agreement of one label map with the truth.

    Parameters
    ----------
    precision, recall, f
        Pixels in common over matched segments, of all found, of all true; harmonic mean.
    p75
        True segments whose match has F > .75, as a share of all true segments.
    weighted_overlap
        Best intersection over union of each true segment, weighted by size.
    over, under
        Share of true pixels outside their segment's best found one; share of pixels that the best
        found segments take from elsewhere.
    true_count, predicted_count
        Segments.
    """

    precision: float
    recall: float
    f: float
    p75: float
    weighted_overlap: float
    over: float
    under: float
    true_count: int
    predicted_count: int


def score_labels(
    predicted: NDArray[np.integer],
    truth: NDArray[np.integer],
    valid: NDArray[np.bool_] | None = None,
) -> SegmentationScore | None:
    """Compare a label map with the truth.

    Parameters
    ----------
    predicted, truth : same shape, integer
        0 = no object; other numbers need not agree or be consecutive.
    valid : same shape, bool, or None
        Pixels whose truth is known; None = all.

    Returns
    -------
    SegmentationScore or None
        None when the truth holds no object.

    Examples
    --------
    >>> truth = np.array([0, 1, 1, 1, 1, 2, 2, 2, 2, 0])
    >>> found = np.array([0, 5, 5, 5, 5, 5, 5, 0, 0, 0])
    >>> score = score_labels(found, truth)
    >>> score.p75, round(score.f, 3), round(score.under, 3)
    (0.5, 0.571, 0.75)
    """
    if predicted.shape != truth.shape or (valid is not None and valid.shape != truth.shape):
        raise ValueError(f"label maps differ in shape: {predicted.shape} and {truth.shape}")
    if valid is not None:
        predicted, truth = predicted[valid], truth[valid]
    common = _contingency(predicted.ravel(), truth.ravel())
    if common.shape[0] < 2:
        return None
    true_sizes, predicted_sizes = common.sum(axis=1)[1:], common.sum(axis=0)[1:]
    common = common[1:, 1:]
    pair_f = 2 * common / (true_sizes[:, None] + predicted_sizes[None])
    rows, columns = linear_sum_assignment(-pair_f)
    matched = float(common[rows, columns].sum())
    precision = matched / max(float(predicted_sizes.sum()), 1.0)
    recall = matched / float(true_sizes.sum())
    return SegmentationScore(
        precision=precision,
        recall=recall,
        f=2 * precision * recall / max(precision + recall, 1e-12),
        p75=float(np.count_nonzero(pair_f[rows, columns] > _GOOD_MATCH) / len(true_sizes)),
        **_best_overlaps(common, true_sizes, predicted_sizes),
        true_count=len(true_sizes),
        predicted_count=len(predicted_sizes),
    )


def _contingency(predicted: NDArray[np.integer], truth: NDArray[np.integer]) -> NDArray[np.float64]:
    """Count common pixels; row and column 0 stand for no object, whether it occurs or not."""
    numbers: list[NDArray[np.integer]] = []
    for labels in (truth, predicted):
        present = np.unique(labels[labels > 0])
        numbers.append(np.where(labels > 0, np.searchsorted(present, labels) + 1, 0))
    rows, columns = numbers
    table = np.zeros((int(rows.max(initial=0)) + 1, int(columns.max(initial=0)) + 1))
    np.add.at(table, (rows, columns), 1.0)
    return table


def _best_overlaps(
    common: NDArray[np.float64],
    true_sizes: NDArray[np.float64],
    predicted_sizes: NDArray[np.float64],
) -> dict[str, float]:
    total = float(true_sizes.sum())
    if common.shape[1] == 0:
        return {"weighted_overlap": 0.0, "over": 1.0, "under": 0.0}
    union = true_sizes[:, None] + predicted_sizes[None] - common
    best = np.argmax(common, axis=1)
    inside = common[np.arange(len(best)), best]
    spilled = np.where(inside > 0, predicted_sizes[best] - inside, 0.0)
    return {
        "weighted_overlap": float((true_sizes * (common / union).max(axis=1)).sum()) / total,
        "over": 1.0 - float(inside.sum()) / total,
        "under": float(spilled.sum()) / total,
    }
