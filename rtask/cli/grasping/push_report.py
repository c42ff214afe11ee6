"""Reports of ``rtask grasp push``: a table for people, JSON for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import announce_more, announce_why_computed

if TYPE_CHECKING:
    from grasp.push import Outline, PushPlan

__all__ = ["plan_as_json", "print_plan"]


def _rows(push_plan: PushPlan, top: int) -> list[dict[str, Any]]:
    import math

    rows = []
    for rank, i in enumerate(push_plan.analysis.order[:top].tolist(), start=1):
        analysis, grasps = push_plan.analysis, push_plan.grasps
        rows.append(
            {
                "rank": rank,
                "contact": grasps.contacts[i].tolist(),
                "angle_deg": math.degrees(grasps.angles[i]),
                "approach": grasps.approaches[i].tolist(),
                "jaw": grasps.jaw(i, push_plan.test.jaw_width).tolist(),
                "opening": float(push_plan.openings[i]),
                "quality": float(analysis.quality[i]),
                "lower_95": float(analysis.lower_95[i]),
                "successes": int(analysis.successes[i]),
                "samples": int(analysis.tried[i]),
                "nominal": bool(push_plan.nominal[i] > 0),
            }
        )
    return rows


def _announce_others(push_plan: PushPlan, top: int) -> None:
    announce_more(max(0, len(push_plan.analysis.order) - top), what="grasps")


def print_plan(push_plan: PushPlan, note: str, top: int) -> None:
    """Print the best ``top`` grasps, and what became of all candidates."""
    analysis = push_plan.analysis
    if note:
        click.echo(note)
    click.echo(
        f"{len(push_plan.part.vertices)} vertices, radius {push_plan.part.radius:.4g}, "
        f"jaws {push_plan.test.jaw_width:.4g} wide, {len(push_plan.grasps)} candidates, "
        f"{analysis.samples} perturbed parts ({analysis.crossed:.0%} cross themselves), "
        f"{push_plan.test.method}, {push_plan.seconds:.3f} s"
        + (", all that were judged in time" if analysis.is_cut else "")
    )
    click.echo("rank  contact                angle    opening   quality  lower 95 %  nominal")
    for row in _rows(push_plan, top):
        x, y = row["contact"]
        click.echo(
            f"{row['rank']:4d}  ({x:9.4g}, {y:9.4g})  {row['angle_deg']:+6.1f}  "
            f"{row['opening']:9.4g}  {row['quality']:8.3f}  {row['lower_95']:10.3f}  "
            f"{'closes' if row['nominal'] else 'fails'}"
        )
    _announce_others(push_plan, top)
    if analysis.crossed > 0.2:
        click.echo(
            f"{analysis.crossed:.0%} of the perturbed outlines cross themselves and count as "
            "failures: lower --vertex-std, or use fewer vertices"
        )
    elif push_plan.quality == 0:
        click.echo("no candidate closes: try more candidates (--density, --angles) or another jaw")
    click.echo("what happened, over all candidates:")
    for reason, count in list(analysis.reasons().items())[:8]:
        click.echo(f"{count / (analysis.samples * len(push_plan.grasps)):8.1%}  {reason}")
    announce_why_computed(
        f"the quality is the share of {analysis.samples} drawn shapes and poses of the part on "
        "which the jaws close; no robot tried these grasps, and --save-plots FOLDER draws them"
    )


def plan_as_json(
    push_plan: PushPlan,
    outline: Outline,
    top: int,
    stored: dict[str, Any] | None,
    drawings: list[str],
) -> dict[str, Any]:
    """Return the plan with its best ``top`` grasps as JSON; lengths in the outline's unit."""
    _announce_others(push_plan, top)
    return {
        "note": outline.note,
        "unit": outline.unit,
        "polygon": push_plan.part.vertices.tolist(),
        "holes": [hole.tolist() for hole in outline.holes],
        "com": push_plan.part.com.tolist(),
        "jaw_width": push_plan.test.jaw_width,
        "candidates": len(push_plan.grasps),
        "evaluations": push_plan.analysis.evaluations,
        "samples": push_plan.analysis.samples,
        "is_cut": push_plan.analysis.is_cut,
        "crossed": push_plan.analysis.crossed,
        "seconds": push_plan.seconds,
        "grasps": _rows(push_plan, top),
        "reasons": push_plan.analysis.reasons(),
        "stored": stored,
        "drawings": drawings,
    }
