"""Confidence from evidence, and the decision from confidences (Kehoe 2014, 4.3).

The constants are shipped; no training step is needed to use them. How they were fitted and what
they achieve stands in ``docs/recognition-measured.md``, with the command that shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "ConfidenceParams",
    "Evidence",
    "confidences",
    "decide",
    "is_size_plausible",
    "likeness",
]

Outcome = Literal["null", "single", "multiple"]


@dataclass(frozen=True)
class Evidence:
    """Evidence for one stored object.

    Parameters
    ----------
    inliers
        Places of its best view whose matches agree on one movement.
    rival_inliers
        The most that any other object has.
    appearance
        Similarity of colours and shapes to its most similar view, 0 to 1.
    appearance_lead
        The same minus that of the most similar other object.
    colour
        Similarity of the colours alone to its most similar view, 0 to 1.
    place_colour
        The same to the view whose places agree.
    size_ok
        Whether the measured size fits the stored ones; None without depth.
    size_gap, place_gap
        Absolute logarithm of the measured size over that of the most similar view, and of the view
        whose places agree; None without depth. Two views from the same side measure the same.
    is_among_many
        So many objects are stored that one of them would look more alike, were it not this one.
    is_twin
        Another object carries the same print: which of the two it is cannot be seen.
    is_solid
        The places agree in space as well: both views have depth.
    has_print
        Query and views have pictures, so that the print between the places was compared.
    is_plain
        The query has so few keypoints that print says little of it: that none agrees with a view
        from another side is no contradiction.
    print_odds
        Logarithmic odds by that comparison; None where too few matches agree.
    family_odds
        The same, had nothing contradicted.
    has_print_colours
        The print agrees so widely that it shows how the camera renders colours, and its own agree.
    likeness
        In colours and shape, as :func:`likeness` measures it; None where the query or all stored
        views of the object have no shape.
    likeness_lead
        The same minus that of the next object.
    """

    inliers: int
    rival_inliers: int
    appearance: float
    appearance_lead: float
    colour: float
    place_colour: float = 0.0
    size_ok: bool | None = None
    size_gap: float | None = None
    place_gap: float | None = None
    is_among_many: bool = False
    is_twin: bool = False
    is_solid: bool = False
    has_print: bool = False
    is_plain: bool = False
    print_odds: float | None = None
    family_odds: float | None = None
    has_print_colours: bool = False
    likeness: float | None = None
    likeness_lead: float = 0.0

    def passes_on_print(self, confidence: float) -> bool:
        """Tell whether the comparison of print alone gives so much confidence."""
        return self.print_odds is not None and _logistic(self.print_odds) >= confidence


@dataclass(frozen=True)
class ConfidenceParams:
    """Constants of the decision.

    Parameters
    ----------
    place_inliers, place_rival, place_colour, place_gap, place_offset
        Weights of the logistic function of agreeing places. Two products that share an emblem
        agree in its places, and differ in colours and size.
    look_colour, look_lead, look_gap, look_rival, look_offset
        Weights of the logistic function of the look, for what carries no print. What agrees in
        places with another object does not look like this one by nature.
    like_own, like_lead, like_offset
        Weights of the same where both sides have a shape: an object has to be alike in colours and
        shape, each to its most similar view, and more so than the next object.
    shape_scale, usual_likeness, max_like_lead
        A difference of shapes counts so many times one of colours; similarity of colours that
        another object reaches anyhow; a larger lead says no more.
    light_gain, light_tint
        Taken off the similarity of colours in another light, for each power of two of brightness
        and of red against blue: what looks alike as it is comes first.
    colour_noise, gap_noise
        Differences of colours and sizes that two views of one object from one side have anyhow.
    min_colour
        Less alike says no more: another light moves colours that far, and thirty places decide.
    max_gap, unknown_gap
        Larger gaps say no more than the first; the second stands in for one without depth.
    threshold
        Kehoe's c_I: the least confidence of an accepted answer.
    listed
        The least confidence of an object in the match set.
    max_rival_share
        Second best confidence over best from which on the answer is ambiguous.
    decisive_inliers
        Fewer inliers may suggest an object, but not decide, unless the size is known to fit and
        either many other objects are stored or the query carries too little print to tell.
    undecided
        The most confidence without that, and of twins.
    twin_lead
        Twins that differ so far in colours and shapes share a mould or an emblem, not their look:
        which of the two it is can be seen. Between views of one print the lead stays below .1.
    min_print_colour
        Less alike in all its colours, print alone may suggest an object, but not decide, unless it
        agrees widely and in its own colours: another light leaves most photographs of one object
        above .6, the same relief in another colour below .1.
    suggestion
        The most confidence of a look without depth, and of places in the image alone, where the
        print has to confirm them.
    contradicting_odds
        Logarithmic odds of print below which it contradicts even what carries little of it.
    refuting_odds
        Logarithmic odds of print below which agreeing places do not decide, in space either: the
        same mould and lettering in another colour agree in every place.
    undecided_from
        The least confidence of a rejected answer that another view may turn.
    family_odds
        Logarithmic odds that the print would have to reach, had nothing contradicted, for the
        view to be called one of the family.
    """

    place_inliers: float = 1.91
    place_rival: float = -0.81
    place_colour: float = 2.78
    place_gap: float = -3.95
    place_offset: float = -10.31
    look_colour: float = 1.85
    look_lead: float = 11.5
    look_gap: float = 0.35
    look_rival: float = -1.0
    look_offset: float = -7.3
    like_own: float = 0.12
    like_lead: float = 3.53
    like_offset: float = -2.85
    shape_scale: float = 2.0
    usual_likeness: float = 0.9
    max_like_lead: float = 1.5
    light_gain: float = 0.03
    light_tint: float = 0.1
    colour_noise: float = 0.02
    gap_noise: float = 0.01
    min_colour: float = 0.65
    max_gap: float = 0.3
    unknown_gap: float = 0.1
    threshold: float = 0.7
    listed: float = 0.2
    max_rival_share: float = 0.5
    decisive_inliers: int = 4
    undecided: float = 0.69
    twin_lead: float = 0.15
    min_print_colour: float = 0.3
    suggestion: float = 0.3
    contradicting_odds: float = -2.0
    refuting_odds: float = -6.0
    undecided_from: float = 0.5
    family_odds: float = 0.85


def confidences(
    evidence: Sequence[Evidence], params: ConfidenceParams | None = None
) -> NDArray[np.float64]:
    """Return how sure the evidence makes that the object is each of those, (k,) in 0..1.

    Examples
    --------
    >>> many = Evidence(20, 0, 0.8, 0.1, 0.95, place_colour=0.95)
    >>> few = Evidence(4, 12, 0.6, -0.1, 0.7, place_colour=0.7)
    >>> (confidences([many, few]) > 0.7).tolist()
    [True, False]
    """
    params = params or ConfidenceParams()
    return np.array([_confidence(e, params) for e in evidence], np.float64)


def _confidence(e: Evidence, params: ConfidenceParams) -> float:
    if e.size_ok is False:
        return 0.0
    is_untested = _is_untested(e, params)
    needs_print = e.has_print and not is_untested
    look = _logistic(_look_odds(e, params))
    is_measured = bool(e.size_ok) and e.size_gap is not None
    if not (is_measured and (e.is_among_many or is_untested)):
        look = min(look, params.undecided)
    if needs_print and e.size_gap is None:
        look = min(look, params.suggestion)
    places = _by_places(e, params)
    if needs_print and not e.is_solid:
        # In the image alone the places of an emblem are as good as any: the print between decides.
        places = min(places, params.suggestion)
    if e.print_odds is not None and e.print_odds < params.refuting_odds:
        places = min(places, params.undecided)
    best = max(look, places, _by_print(e, params))
    is_undecided = e.is_twin and e.appearance_lead < params.twin_lead
    return min(best, params.undecided) if is_undecided else best


def _is_untested(e: Evidence, params: ConfidenceParams) -> bool:
    """Tell whether there is too little print to confirm an object, and none that contradicts it."""
    contradicts = e.print_odds is not None and e.print_odds < params.contradicting_odds
    return e.is_plain and not contradicts


def _by_print(e: Evidence, params: ConfidenceParams) -> float:
    """Return how sure the comparison of print makes."""
    if e.print_odds is None:
        return 0.0
    sure = _logistic(e.print_odds)
    is_alike = e.colour >= params.min_print_colour or e.has_print_colours
    return sure if is_alike else min(sure, params.suggestion)


def _by_places(e: Evidence, params: ConfidenceParams) -> float:
    """Return how sure the agreeing places make."""
    if e.inliers < params.decisive_inliers:
        return 0.0
    return _logistic(
        params.place_inliers * np.log2(1 + e.inliers)
        + params.place_rival * np.log2(1 + e.rival_inliers)
        + params.place_colour * _closeness(e.place_colour, params)
        + params.place_gap * min(e.place_gap or 0.0, params.max_gap)
        + params.place_offset
    )


def _look_odds(e: Evidence, params: ConfidenceParams) -> float:
    """Return the logarithmic odds by the look alone."""
    if e.likeness is not None:
        lead = min(max(e.likeness_lead, -params.max_like_lead), params.max_like_lead)
        return params.like_own * e.likeness + params.like_lead * lead + params.like_offset
    gap = params.unknown_gap if e.size_gap is None else min(e.size_gap, params.max_gap)
    return float(
        params.look_colour * _closeness(e.colour, params)
        + params.look_lead * min(max(e.appearance_lead, -0.2), 0.2)
        - params.look_gap * np.log(params.gap_noise + gap)
        + params.look_rival * np.log2(1 + e.rival_inliers)
        + params.look_offset
    )


def likeness(
    colour: NDArray[np.floating], shape: NDArray[np.floating], params: ConfidenceParams
) -> NDArray[np.float64]:
    """Return how alike things are in both, by the less alike of the two.

    Things of one colour differ in shape, and things of one shape in their print: either may say
    that a thing is another one, and neither that it is the same.

    Parameters
    ----------
    colour, shape : (k,) float
        Similarities, -1 where a shape is not known: then colours decide alone.

    Returns
    -------
    (k,) float64
        1.0 to 3.9.

    Examples
    --------
    >>> colour, shape = np.array([0.99, 0.99, 0.7]), np.array([0.99, 0.9, 0.99])
    >>> likeness(colour, shape, ConfidenceParams()).round(1).tolist()
    [3.2, 1.5, 1.1]
    """
    apart = 1.0 - np.clip(colour, params.min_colour, 1.0)
    differ = np.where(shape < 0, 0.0, params.shape_scale * (1.0 - np.clip(shape, 0.0, 1.0)))
    least: NDArray[np.float64] = -np.log(params.colour_noise + np.maximum(apart, differ))
    return least


def _closeness(similarity: float, params: ConfidenceParams) -> float:
    """Return 1.0 for other colours to 3.9 for the same ones: the last percents say most."""
    similarity = min(max(similarity, params.min_colour), 1.0)
    return float(-np.log(params.colour_noise + 1.0 - similarity))


def _logistic(score: float) -> float:
    return float(1.0 / (1.0 + np.exp(-np.clip(score, -60, 60))))


def is_size_plausible(size_m: float, is_cut: bool, stored_m: NDArray[np.floating]) -> bool | None:
    """Compare the visible diagonal with those of an object's stored views.

    Parameters
    ----------
    size_m
        Of the query, NaN without depth.
    is_cut
        The query shows only part of its object: then it may be smaller, never larger.
    stored_m : (k,) float, m
        NaN without depth.

    Returns
    -------
    bool or None
        None when either side has no size.
    """
    sizes = stored_m[np.isfinite(stored_m)]
    if not np.isfinite(size_m) or len(sizes) == 0:
        return None
    slack = min(0.010, 0.15 * float(sizes.max()))
    if size_m > 1.15 * float(sizes.max()) + slack:
        return False
    return bool(is_cut or size_m >= 0.85 * float(sizes.min()) - slack)


def decide(
    ranked: NDArray[np.floating], min_confidence: float, params: ConfidenceParams | None = None
) -> tuple[Outcome, bool]:
    """Return Kehoe's outcome and whether the best answer is accepted.

    Parameters
    ----------
    ranked : (k,) float
        Confidences, best first.

    Examples
    --------
    >>> decide(np.array([0.95, 0.1]), 0.7), decide(np.array([0.95, 0.6]), 0.7)
    (('single', True), ('multiple', False))
    """
    params = params or ConfidenceParams()
    listed = ranked[ranked >= params.listed]
    if len(listed) == 0:
        return "null", False
    second = float(ranked[1]) if len(ranked) > 1 else 0.0
    clear = second < params.max_rival_share * float(ranked[0])
    accepted = bool(ranked[0] >= min_confidence and clear)
    return ("single" if len(listed) == 1 else "multiple"), accepted
