"""Agreement of a query with all views of an object, where its mask is a guess.

One stored view may show no more than siblings share, because a hand or the cut hides the rest: it
must not decide alone. The object's other views show the rest, and there the sibling does not agree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from features.recognition.comparison.alignment import Alignment, align_views
from features.recognition.comparison.difference import Comparison, compare_pictures
from features.recognition.comparison.evidence import ViewFacts
from features.recognition.comparison.store_facts import StoreFacts
from features.recognition.index.snapshot import Snapshot
from features.recognition.views.picture import ViewPicture
from features.recognition.views.view import ViewFeatures

__all__ = ["AllViewsParams", "agreement_of_views", "odds_of_views"]


@dataclass(frozen=True)
class AllViewsParams:
    """Constants of the agreement with all views.

    Parameters
    ----------
    min_views
        Objects with fewer stored views are left to the view that agrees best.
    min_odds
        Less likely objects are not looked at: no agreement makes them likely.
    max_aligned, max_compared
        Views that are aligned, by their look, and of those compared, by their matches.
    min_matches
        Of a view that is compared.
    kept, max_odds, even_odds
        Share that is kept of the odds by the best view, at most so high, around the accepted ones.
    weight, usual
        Of the agreement; more than usual speaks for the object, less against it.
    """

    min_views: int = 4
    min_odds: float = -1.5
    max_aligned: int = 24
    max_compared: int = 9
    min_matches: int = 8
    kept: float = 0.34
    max_odds: float = 6.0
    even_odds: float = 0.85
    weight: float = 12.0
    usual: float = 0.71


def agreement_of_views(
    query: ViewFeatures,
    snapshot: Snapshot,
    facts: StoreFacts,
    number: int,
    params: AllViewsParams | None = None,
) -> float | None:
    """Return the share of cells that agree, over all views of an object that match the query.

    A cell counts once for each view that shows it, and only where that view's object supports it.
    None where the object has few views, or none of them matches; 0 where those that match show
    nothing that is supported.
    """
    params = params or AllViewsParams()
    views = np.flatnonzero((snapshot.object_of_view == number) & snapshot.alive)
    if len(views) < params.min_views or not query.picture:
        return None
    if len(views) > params.max_aligned:
        alike = snapshot.appearance(query.appearance)[views]
        views = np.sort(views[np.argsort(-alike, kind="stable")[: params.max_aligned]])
    matching: list[tuple[int, Alignment]] = []
    for view in views.tolist():
        alignment = align_views(query, snapshot.stored_view(view), query.side_px)
        if alignment is not None and len(alignment) >= params.min_matches:
            matching.append((view, alignment))
    matching.sort(key=lambda pair: (-len(pair[1]), snapshot.view_iris[pair[0]]))
    picture = ViewPicture.from_bytes(query.picture)
    shown = agreeing = 0
    for view, alignment in matching[: params.max_compared]:
        stored = facts.picture(snapshot, view)
        if stored is None:
            continue
        places = query.keypoints[alignment.query_rows, :2]
        comparison = compare_pictures(picture, stored, alignment.query_from_view, places)
        counted = _cells(comparison, facts.supported(snapshot, view))
        shown, agreeing = shown + counted[0], agreeing + counted[1]
    return agreeing / shown if shown else (0.0 if matching else None)


def _cells(comparison: Comparison, facts: ViewFacts) -> tuple[int, int]:
    """Return how many cells of the query a view shows, and how many of them agree."""
    seen = (comparison.view_cell >= 0) & comparison.near
    shown = seen & facts.believed[comparison.view_cell]
    return int(np.count_nonzero(shown)), int(np.count_nonzero(shown & comparison.agrees))


def odds_of_views(odds: float, agreement: float, params: AllViewsParams | None = None) -> float:
    """Return the logarithmic odds by the best view and by the agreement of all views.

    Examples
    --------
    >>> round(odds_of_views(3.0, 0.85), 2), round(odds_of_views(3.0, 0.6), 2)
    (3.26, 0.26)
    """
    params = params or AllViewsParams()
    from_best = params.kept * (min(odds, params.max_odds) - params.even_odds)
    return params.even_odds + from_best + params.weight * (agreement - params.usual)
