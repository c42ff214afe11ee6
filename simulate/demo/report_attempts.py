"""What one robot did with one product, as the report of a demo shows it."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from rtask.engine.words import phase_words, reason_words
from simulate.demo.report_hand import draw_hands, hand_data

__all__ = ["GRASP_WORDS", "attempt_pictures", "phase_of", "robot_cell"]

GRASP_WORDS = {
    "memory": "remembered grasp",
    "candidate": "grasp proposed from its shape",
    "scene": "grasp planned on the whole view",
    "none": "no grasp",
}
_BESIDE = "; alone: "
"""Between what the graph told of a grasp and the grasp that geometry alone would have chosen."""


def attempt_pictures(folder: Path, robot: str, attempt: Mapping[str, Any]) -> list[Path]:
    """Return the pictures of an attempt in the order in which they were taken."""
    phases = attempt.get("pictures")
    return [
        path for path in sorted((folder / robot).glob(f"{attempt['run']:02d}-*-*.*"))
        # One of the same number may have got further at an earlier table, or in an earlier run.
        if phases is None or phase_of(path) in phases
    ]  # fmt: skip


def phase_of(picture: Path) -> str:
    """Return the phase of an attempt that a picture shows, such as ``closed``."""
    return picture.stem.split("-")[-1]


def robot_cell(
    folder: Path, robot: str, is_shared: bool | None, met: Mapping[str, Any] | None
) -> tuple[str, int]:
    """Return a robot's attempts at a product as HTML, and how many it made.

    Parameters
    ----------
    folder
        Of the report, with one folder of pictures for each robot.
    is_shared
        Whether it worked with the shared graph or with one of its own; None if there is nothing to
        compare it with.
    met
        Its encounters with the product, joined; None if it did not see it.
    """
    manner = "" if is_shared is None else "with the graph" if is_shared else "without it"
    head = f"<h3>{escape(robot)} <small>{manner}</small></h3>"
    if met is None:
        return f'<div class="robot">{head}<p>did not see it</p></div>', 0
    tried = [attempt for attempt in met["attempts"] if attempt.get("run")]
    parts = [head, f"<p>{escape(_familiarity(met))}</p>"]
    if met.get("hidden"):
        parts.append(draw_hands(met["hidden"], tried))
    if tried:
        parts.append('<div class="bar" aria-hidden="true"><i></i></div>')
        items = [
            _attempt(folder, robot, number, attempt, is_shared is not False)
            for number, attempt in enumerate(tried, start=1)
        ]
        parts.append(f'<ol class="tries">{"".join(items)}</ol>')
    for attempt in met["attempts"]:
        if not attempt.get("run"):
            reason = reason_words(attempt["reason"]) or "refused"
            parts.append(f'<p class="bad">not grasped: {escape(reason)}</p>')
    if met.get("lost"):
        parts.append('<p class="bad">went out of sight</p>')
    return f'<div class="robot">{"".join(parts)}</div>', len(tried)


def _familiarity(met: Mapping[str, Any]) -> str:
    if not met["recognised"]:
        return "new to it"
    return f"recognised as {met['label'] or 'an object'} ({met['confidence']:.0%} sure)"


def _attempt(
    folder: Path, robot: str, number: int, attempt: Mapping[str, Any], is_shared: bool
) -> str:
    succeeded = attempt["held"] and attempt["place_reason"] != "slip_transport"
    done = "held and placed" if attempt["placed"] else "held" if attempt["held"] else "not held"
    why = attempt["place_reason"] if attempt["held"] else attempt["reason"]
    if attempt["held"] and why == "not_judged":
        done += "; it could not see where it put it down"
    elif why not in ("ok", ""):
        done += f"{', but' if attempt['held'] else ':'} {reason_words(why)}"
    grasp = GRASP_WORDS.get(attempt["source"], f"grasp from {attempt['source']}")
    hand = f' data-hand="{hand_data(attempt["hand"])}"' if attempt.get("hand") else ""
    belief = float(attempt.get("mean", 0.0))
    parts = [
        f'<p><b class="{"good" if succeeded else "bad"}">{number}. {escape(done)}</b></p>',
        _pictures(folder, robot, attempt, succeeded),
        f"<p>{escape(grasp)}, believed {belief:.0%} likely to hold</p>",
        _advice(str(attempt.get("alone", "")), is_shared),
    ]
    if attempt.get("evidence"):
        parts.append(
            f"<details><summary>What it measured</summary><p>{escape(attempt['evidence'])}</p>"
            "</details>"
        )
    return f'<li data-belief="{belief:.2f}"{hand}>{"".join(parts)}</li>'


def _advice(text: str, is_shared: bool) -> str:
    """Return what the robot's graph told of the grasp, and where geometry would have led."""
    if not text:
        return ""
    evidence, _, otherwise = text.partition(_BESIDE)
    line = f"<p>{'The' if is_shared else 'Its own'} {escape(evidence)}."
    if otherwise:
        other = f"a grasp {otherwise}" if otherwise[0].isdigit() else otherwise
        line += f" Geometry alone would have chosen {escape(other)}."
    return f"{line}</p>"


def _pictures(folder: Path, robot: str, attempt: Mapping[str, Any], succeeded: bool) -> str:
    """Return the picture of the moment of success or failure, and the others folded away."""
    paths = attempt_pictures(folder, robot, attempt)
    if not paths:
        return ""
    phases = [phase_of(path) for path in paths]
    moment = phases.index("held") if succeeded and "held" in phases else len(paths) - 1
    kept = attempt["placed"] or attempt["place_reason"] != "slip_transport"
    shots = [_shot(robot, path, phase, kept) for path, phase in zip(paths, phases, strict=True)]
    others = "".join(
        shot.replace("<img ", '<img loading="lazy" ', 1)
        for number, shot in enumerate(shots)
        if number != moment
    )
    if not others:
        return shots[moment]
    return (
        f"{shots[moment]}<details><summary>More pictures</summary>"
        f'<div class="shots">{others}</div></details>'
    )


def _shot(robot: str, path: Path, phase: str, kept: bool) -> str:
    # A hand that lost the product on the way opens over its box all the same.
    is_empty = phase == "placed" and not kept
    words = escape("after it was lost" if is_empty else phase_words(phase))
    return (
        f'<figure><img src="{escape(robot)}/{escape(path.name)}" alt="{words}">'
        f"<figcaption>{words}</figcaption></figure>"
    )
