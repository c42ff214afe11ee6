"""Reports of ``rtask grasp plan`` on push grasps: a table for people, JSON for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from grasp.push import Outline, PushPlan

__all__ = ["plan_as_json", "print_plan"]


def _rows(found: PushPlan, top: int) -> list[dict[str, Any]]:
    import math

    rows = []
    for rank, i in enumerate(found.analysis.order[:top].tolist(), start=1):
        analysis, grasps = found.analysis, found.grasps
        rows.append(
            {
                "rank": rank,
                "contact": grasps.contacts[i].tolist(),
                "angle_deg": math.degrees(grasps.angles[i]),
                "approach": grasps.approaches[i].tolist(),
                "jaw": grasps.jaw(i, found.test.jaw_width).tolist(),
                "opening": float(found.openings[i]),
                "quality": float(analysis.quality[i]),
                "lower_95": float(analysis.lower_95[i]),
                "successes": int(analysis.successes[i]),
                "samples": int(analysis.tried[i]),
                "nominal": bool(found.nominal[i] > 0),
            }
        )
    return rows


def print_plan(found: PushPlan, note: str, top: int) -> None:
    """Print the best ``top`` grasps, and what became of all candidates."""
    analysis = found.analysis
    if note:
        click.echo(note)
    click.echo(
        f"{len(found.part.vertices)} vertices, radius {found.part.radius:.4g}, "
        f"jaws {found.test.jaw_width:.4g} wide, {len(found.grasps)} candidates, "
        f"{analysis.samples} perturbed parts ({analysis.crossed:.0%} cross themselves), "
        f"{found.test.method}, {found.seconds:.3f} s"
        + (", all that were judged in time" if analysis.is_cut else "")
    )
    click.echo("rank  contact                angle    opening   quality  lower 95 %  nominal")
    for row in _rows(found, top):
        x, y = row["contact"]
        click.echo(
            f"{row['rank']:4d}  ({x:9.4g}, {y:9.4g})  {row['angle_deg']:+6.1f}  "
            f"{row['opening']:9.4g}  {row['quality']:8.3f}  {row['lower_95']:10.3f}  "
            f"{'closes' if row['nominal'] else 'fails'}"
        )
    if analysis.crossed > 0.2:
        click.echo(
            f"{analysis.crossed:.0%} of the perturbed outlines cross themselves and count as "
            "failures: lower --vertex-std, or use fewer vertices"
        )
    elif found.quality == 0:
        click.echo("no candidate closes: try more candidates (--density, --angles) or another jaw")
    click.echo("what happened, over all candidates:")
    for reason, count in list(analysis.reasons().items())[:8]:
        click.echo(f"{count / (analysis.samples * len(found.grasps)):8.1%}  {reason}")


def plan_as_json(
    found: PushPlan,
    outline: Outline,
    top: int,
    stored: dict[str, Any] | None,
    drawings: list[str],
) -> dict[str, Any]:
    """Return the plan with its best ``top`` grasps as JSON; lengths in the outline's unit."""
    return {
        "note": outline.note,
        "unit": outline.unit,
        "polygon": found.part.vertices.tolist(),
        "holes": [hole.tolist() for hole in outline.holes],
        "com": found.part.com.tolist(),
        "jaw_width": found.test.jaw_width,
        "candidates": len(found.grasps),
        "evaluations": found.analysis.evaluations,
        "samples": found.analysis.samples,
        "is_cut": found.analysis.is_cut,
        "crossed": found.analysis.crossed,
        "seconds": found.seconds,
        "grasps": _rows(found, top),
        "reasons": found.analysis.reasons(),
        "stored": stored,
        "drawings": drawings,
    }
