"""Words for people in place of the codes that robots report, as filters of templates."""

from __future__ import annotations

from endpoint.activity.words import title
from endpoint.pages.render import blueprint
from rtask.engine.words import phase_words, reason_words

__all__ = ["VISIBLE_REASONS"]

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

for _words in (phase_words, reason_words, title):
    blueprint.add_app_template_filter(_words)
