"""Words for people in place of codes: why an attempt ended, and when a picture was taken."""

from __future__ import annotations

__all__ = [
    "PHASES", "REASONS", "contradiction_words", "likeness_words", "phase_words", "reason_words",
]  # fmt: skip

PHASES = {  # in the order of time; robots may store others
    "pre_grasp": "before the grasp",
    "closed": "hand closed",
    "lifted": "lifted",
    "held": "held up",
    "placed": "put down",
}

REASONS = {
    "ok": "as intended",
    "timed_out": "the time allowed ran out",
    "stopped_by_human": "a person stopped it",
    "hardware": "the hardware failed",
    "not_judged": "nobody judged it",
    "no_match": "the object was not recognised",
    "low_recognition": "the robot was not sure which object it saw",
    "wrong_object": "it was another object",
    "pose_unknown": "the robot could not tell where the object was",
    "low_pose": "the robot was not sure where the object was",
    "no_grasp": "no grasp was known",
    "low_grasp": "no grasp was promising enough",
    "ik": "the hand could not reach it",
    "tilt": "the hand would have had to tilt too far",
    "grasp_collision": "the hand would have hit something",
    "approach_ik": "the hand could not approach it",
    "approach_collision": "the arm would have hit something on the approach",
    "pregrasp_collision": "the arm would have hit something before the approach",
    "lift_ik": "the hand could not have lifted it",
    "rrt_start": "the arm was too close to something to start",
    "rrt_goal": "the arm would have ended too close to something",
    "rrt_time": "no way there was found in time",
    "too_heavy": "it is too heavy for the arm",
    "too_wide": "it is too wide for the hand",
    "tracking": "the arm left its planned path",
    "touched": "it moved before the hand closed",
    "pushed_away": "the hand pushed it out of reach",
    "missed": "the hand closed without holding it",
    "slip_lift": "it slipped out while being lifted",
    "slip_hold": "it slipped out while being held",
    "slip_transport": "it slipped out on the way",
    "place_plan": "no way to put it down was found",
    "drop_outside": "it was put down in the wrong place",
    "crushed": "it gave way under the fingers",
    "came_apart": "a part of it came off",
}


def reason_words(code: str | None) -> str:
    """Say in words why an attempt ended as it did.

    Examples
    --------
    >>> reason_words("ik"), reason_words("out_of_oil"), reason_words(None)
    ('the hand could not reach it', 'out of oil', '')
    """
    return REASONS.get(code or "", (code or "").replace("_", " "))


def phase_words(phase: str) -> str:
    """Say in words when a picture of an attempt was taken.

    Examples
    --------
    >>> phase_words("placed"), phase_words("half_way"), phase_words("view")
    ('put down', 'half way', 'as it was seen')
    """
    return "as it was seen" if phase == "view" else PHASES.get(phase, phase.replace("_", " "))


def contradiction_words(seen: str, stored: str, name: str) -> str:
    """Say which printed word tells a view from an object; both words are quoted, as untrusted text.

    Examples
    --------
    >>> contradiction_words("NATURELL", "VANILJ", "vanilla")
    'says "NATURELL" where vanilla says "VANILJ"'
    """
    here, there = (text.replace('"', "'") for text in (seen, stored))
    return f'says "{here}" where {name} says "{there}"'


def likeness_words(inliers: int, appearance: float, size_ok: bool | None) -> str:
    """Say what a confidence that a view shows an object rests on.

    Parameters
    ----------
    inliers
        Places that agree on one movement with a stored view.
    appearance
        Similarity of colours and shapes to the most similar view, 0 to 1.
    size_ok
        Whether the measured size fits; None without depth.

    Examples
    --------
    >>> likeness_words(1, 0.831, True)
    '1 place agrees with a stored view; colours and shapes are alike to 83 %; the size fits'
    """
    places = "1 place agrees" if inliers == 1 else f"{inliers or 'no'} places agree"
    size = {
        True: "the size fits",
        False: "the size does not fit",
        None: "the size was not measured",
    }[size_ok]
    alike = f"colours and shapes are alike to {100 * appearance:.0f} %"
    return f"{places} with a stored view; {alike}; {size}"
