"""Words for people in place of the codes that robots report."""

from __future__ import annotations

from endpoint.activity.words import reason_words, title
from endpoint.pages.render import blueprint

__all__ = ["PHASES", "VISIBLE_REASONS", "phase_words", "reason_words", "title"]

# In the order of time; robots may store others.
PHASES = {
    "pre_grasp": "before the grasp",
    "closed": "hand closed",
    "lifted": "lifted",
    "held": "held up",
    "placed": "put down",
}
# What a person can see on the pictures; the keys 1 to 9 choose these.
VISIBLE_REASONS = (
    "missed",
    "slip_lift",
    "slip_hold",
    "slip_transport",
    "pushed_away",
    "touched",
    "drop_outside",
    "wrong_object",
    "hardware",
)


@blueprint.app_template_filter("phase_words")
def phase_words(phase: str) -> str:
    """Say in words when a picture was taken.

    Examples
    --------
    >>> phase_words("placed"), phase_words("half_way"), phase_words("view")
    ('put down', 'half way', 'as it was seen')
    """
    return "as it was seen" if phase == "view" else PHASES.get(phase, phase.replace("_", " "))


blueprint.add_app_template_filter(reason_words)
blueprint.add_app_template_filter(title)
