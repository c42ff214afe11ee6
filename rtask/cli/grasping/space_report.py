"""Reports of grasps in space: a table for people, JSON for programs, and files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.grasping.planning import announce_stored
from rtask.cli.options import announce_more, announce_why_computed, print_json

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.cli.grasping.spatial import SpatialCall

    Shape = Mesh | NDArray[np.float64]

__all__ = ["report", "verdict"]


def report(
    proposals: Proposals, hand: EndEffector, shape: Shape, call: SpatialCall, as_json: bool,
    note: str, name: str, seconds: float, stored: dict[str, Any] | None,
) -> bool:  # fmt: skip
    """Print ranked grasps and write the files that a call asks for.

    Parameters
    ----------
    note
        About the shape.
    name
        Of the source, for the file of grasps.
    stored
        Answer of the engine, if grasps were stored.

    Returns
    -------
    bool
        Whether a grasp is confident enough.
    """
    written = _written(proposals, hand, shape, call, name)
    notes = [note, *proposals.notes]
    if as_json:
        print_json(_as_json(proposals, hand, notes, seconds, call, stored, written))
        return not verdict(proposals, call)
    _print(proposals, hand, notes, seconds, call)
    if stored is not None:
        announce_stored(stored)
    for path in written:
        click.echo(f"wrote {path}")
    return not verdict(proposals, call)


def verdict(proposals: Proposals, call: SpatialCall) -> str:
    """Return why not to grasp, or ""."""
    if not proposals:
        advice = f"; {proposals.advice}" if proposals.advice else ""
        return f"no grasp found: {proposals.reason}{advice}"
    best = max(c.scores["confidence"] for c in proposals)
    if best < call.min_confidence:
        return f"no grasp found: the best confidence is {best:.2f} < {call.min_confidence}"
    return ""


def _written(
    proposals: Proposals, hand: EndEffector, shape: Shape, call: SpatialCall, name: str
) -> list[str]:
    """Write the drawing and the file of grasps, if they are asked for; return their paths."""
    from grasp.spatial.drawing import candidates_svg
    from grasp.spatial.interchange import write_grasps

    written: list[Path] = []
    if call.save_plots is not None:
        written.append(call.save_plots / "candidates_3d.svg")
        written[-1].write_text(candidates_svg(proposals.candidates, hand, shape), "utf-8")
    if call.save_grasps is not None:
        write_grasps(call.save_grasps, proposals.candidates, hand, name, call.scale)
        written.append(call.save_grasps)
    return [str(path) for path in written]


def _rows(proposals: Proposals, limit: int) -> list[dict[str, Any]]:
    from grasp.spatial.candidate import to_planar

    rows = []
    for rank, c in enumerate(proposals.candidates[:limit], start=1):
        try:
            planar = to_planar(c)
        except ValueError:
            planar = None
        rows.append(
            {
                "rank": rank,
                "position": c.centre.tolist(),
                "approach": c.approach.tolist(),
                "closing": c.closing.tolist(),
                "width": c.width,
                "opening": c.opening,
                "antipodal": c.antipodal,
                "segment": c.segment,
                "completed": c.completed,
                **{name: float(value) for name, value in c.scores.items()},
                "planar": planar and {"x": planar.x, "y": planar.y, "theta": planar.theta},
                "features": None if c.features is None else c.features.tolist(),
            }
        )
    return rows


def _print(
    proposals: Proposals, hand: EndEffector, notes: list[str], seconds: float, call: SpatialCall
) -> None:
    for note in notes:
        click.echo(note)
    click.echo(
        f"{hand.name}, {_size(hand)}, friction {hand.friction:g}: {len(proposals)} grasps, "
        f"{call.samples} poses each, {seconds:.3f} s"
    )
    if proposals:
        held = "  lift  carry" if "carry" in proposals[0].scores else ""
        held += "  moves  object" if "moves" in proposals[0].scores else ""
        click.echo(
            "rank   x, y, z mm             approach               width  s_G   95 %  epsilon" + held
        )
    for row in _rows(proposals, call.limit):
        x, y, z = (1000 * v for v in row["position"])
        a, b, c = row["approach"]
        chances = [row.get(f"{name}_chance", row.get(name)) for name in ("lift", "carry")]
        held = f"  {chances[0]:.2f}   {chances[1]:.2f}" if "carry" in row else ""
        held += f"  {row['moves']:.2f}   {row['segment']:6d}" if "moves" in row else ""
        click.echo(
            f"{row['rank']:4d}  ({x:6.1f},{y:6.1f},{z:6.1f})  ({a:+.2f},{b:+.2f},{c:+.2f})  "
            f"{1000 * row['width']:7.1f}  {row['confidence']:.2f}  {row['lower_95']:.2f}  "
            f"{row.get('epsilon', 0.0):7.4f}{held}{'  half' if row['antipodal'] == 'half' else ''}"
        )
    announce_more(max(0, len(proposals) - call.limit), what="grasps")
    why_not = verdict(proposals, call)
    if why_not:
        click.echo(why_not)
    click.echo("what happened:")
    for name, count in proposals.counts.items():
        click.echo(f"{count:8d}  {name}")
    if proposals:
        announce_why_computed(
            f"computed from the shape alone, with {call.samples} drawn errors of its pose; no "
            "robot tried these grasps, and --save-plots FOLDER draws them"
        )


def _size(hand: EndEffector) -> str:
    from grasp.spatial.suction_cup import SuctionCup

    if isinstance(hand, SuctionCup):
        return f"lip {2000 * hand.radius:.0f} mm wide, vacuum {hand.force:.0f} N"
    return f"stroke {1000 * hand.max_opening:.0f} mm"


def _as_json(
    proposals: Proposals, hand: EndEffector, notes: list[str], seconds: float,
    call: SpatialCall, stored: dict[str, Any] | None, written: list[str],
) -> dict[str, Any]:  # fmt: skip
    from grasp.messages import spatial_grasp_message

    announce_more(max(0, len(proposals) - call.limit), what="grasps")
    rows = _rows(proposals, call.limit)
    for row, candidate in zip(rows, proposals.candidates, strict=False):
        row["message"] = spatial_grasp_message(candidate, hand, "object")
    return {
        "notes": notes,
        "gripper": hand.name,
        "seconds": seconds,
        "verdict": verdict(proposals, call),
        "grasps": rows,
        "counts": dict(proposals.counts),
        "stored": stored,
        "drawings": written,
    }
