"""``rtask world export``: the scene at an instant as a file for other programs."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import open_to_read, read_address
from rtask.cli.options import data_option, json_option, print_json, server_option
from rtask.cli.things import name_or_iri
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.world.scene import Scene

__all__ = ["world"]


@click.group()
def world() -> None:
    """Take what is where out of the graph."""


@world.command()
@click.argument("target", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--at", metavar="TIME", help="Time of the scene, ISO 8601; default: now.")
@click.option(
    "--frame",
    help="A frame of the tree to write: its name in tf, ROBOT/NAME or its IRI; default: the tree "
    "in which most things are.",
)
@data_option
@server_option
@json_option
def export(
    target: Path, at: str | None, frame: str | None, data: Path, server: str | None, as_json: bool
) -> None:
    """Write the scene at a time to the file TARGET, as glTF (.glb) or OpenUSD (.usda).

    Frames, robots, things and grasps are nodes with their IRIs. What cannot be drawn, because
    nobody knows its pose, is listed.
    """
    from rtask.rdf.terms import moment
    from rtask.world.scene import FORMATS

    suffix = target.suffix.removeprefix(".").lower()
    if suffix not in FORMATS:
        raise UsageError(f"{target}: expected a name that ends in .{' or .'.join(FORMATS)}")
    asked_s = None if at is None else moment(at).timestamp()
    if frame is not None:
        frame = name_or_iri(frame, data, server)
    if server:
        asked = {name: text for name, text in (("at", at), ("frame", frame)) if text}
        content = read_address(server, f"/world/scene.{suffix}", asked)
        target.write_bytes(content)
        _announce(as_json, {"target": str(target), "bytes": len(content)})
        return
    with open_to_read(data) as kb:
        scene = kb.world.scene(asked_s, frame)
    content = _written(scene, suffix)
    target.write_bytes(content)
    _announce(as_json, {"target": str(target), "bytes": len(content), **_summary(scene)})


def _written(scene: Scene, suffix: str) -> bytes:
    from rtask.world.scene import glb, usda

    return glb(scene) if suffix == "glb" else usda(scene).encode()


def _summary(scene: Scene) -> dict[str, object]:
    kinds = [node.kind for node in scene.nodes]
    return {
        "root": scene.root,
        **{f"{kind}s": kinds.count(kind) for kind in ("frame", "robot", "thing", "grasp")},
        "unplaced": [asdict(left_out) for left_out in scene.unplaced],
        "other_roots": [{"frame": root, "things": things} for root, things in scene.other_roots],
    }


def _announce(as_json: bool, summary: dict[str, object]) -> None:
    if as_json:
        print_json(summary)
        return
    click.echo(f"{summary['target']}: {summary['bytes']} bytes", err=True)
    if "things" not in summary:
        return
    words = ", ".join(
        f"{summary[name]} {name}" for name in ("things", "robots", "frames", "grasps")
    )
    click.echo(words, err=True)
    unplaced, others = summary["unplaced"], summary["other_roots"]
    assert isinstance(unplaced, list)
    assert isinstance(others, list)
    for left_out in unplaced:
        click.echo(f"not drawn: {left_out['label']}: {left_out['reason']}", err=True)
    for other in others:
        click.echo(f"another tree: --frame {other['frame']} ({other['things']} things)", err=True)
