"""``rtask grasp plan`` in space: a mesh, a cloud, or an object of the graph, and a gripper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import print_json
from rtask.cli.progress import Working

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.contact_plan import OtherHand
    from grasp.spatial.gripper import EndEffector, ParallelGripper
    from grasp.spatial.hand_search.shipped import Filter
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.engine.records.shapes import ObjectShape

    Shape = Mesh | NDArray[np.float64]

__all__ = ["is_mesh", "plan_in_space"]


def is_mesh(path: Path) -> bool:
    """Tell whether a file is a triangle mesh, by its name; for PLY files, by their contents."""
    from grasp.spatial.meshes.mesh_files import MESH_ENDINGS, has_faces

    ending = path.suffix.lower()
    if ending not in MESH_ENDINGS or not path.is_file():
        return False
    return ending != ".ply" or has_faces(path)


def plan_in_space(source: str, data: Path, as_json: bool, options: dict[str, Any]) -> bool:
    """Rank grasps of ``source`` in space; print, draw and store them as the options say.

    Returns
    -------
    bool
        Whether a grasp is confident enough.
    """
    import time

    from grasp.spatial.gripper_files import end_effector_named

    gripper = end_effector_named(options["gripper"])
    if options["friction"] is not None:
        from dataclasses import replace

        gripper = replace(gripper, friction=options["friction"])
    _check_options(options)
    shape, note, stored_shape = _shape(source, data, options)
    if stored_shape is None:
        _check_for(source, shape, options)
    start = time.perf_counter()
    with Working("planning"):
        proposals = _planned(shape, stored_shape, gripper, options)
    seconds = time.perf_counter() - start
    stored = None
    if options["store"] and stored_shape is not None:
        stored = _store(data, stored_shape, proposals, gripper, options)
    drawings = _draw(proposals, gripper, shape, options) if options["plots"] else []
    if options["save_grasps"] is not None:
        from grasp.spatial.gripper import ParallelGripper
        from grasp.spatial.interchange import write_grasps

        assert isinstance(gripper, ParallelGripper)
        name = Path(source).name if Path(source).is_file() else source
        write_grasps(options["save_grasps"], proposals.candidates, gripper, name, options["scale"])
        drawings.append(str(options["save_grasps"]))
    notes = [note, *proposals.notes]
    if as_json:
        print_json(_as_json(proposals, gripper, notes, seconds, options, stored, drawings))
        return not _verdict(proposals, options)
    _print(proposals, gripper, notes, seconds, options)
    if stored is not None:
        many = f"{len(stored['grasps'])} grasps"
        message = f"stored {many} as {stored['commit']}"
        click.echo(message if stored["commit"] else f"the object has these {many} already")
    for drawing in drawings:
        click.echo(f"wrote {drawing}")
    return not _verdict(proposals, options)


def _check_options(options: dict[str, Any]) -> None:
    """Refuse before planning what only shows after it."""
    import math

    from rtask.errors import UsageError

    for place in options["viewpoint"]:
        if not all(map(math.isfinite, place)):
            raise UsageError(f"--viewpoint {' '.join(map(str, place))}: expected numbers, m")
    target: Path | None = options["save_grasps"]
    if target is not None and not target.absolute().parent.is_dir():
        raise UsageError(f"--save-grasps {target}: there is no folder {target.parent}")


def _check_for(source: str, shape: Shape, options: dict[str, Any]) -> None:
    """Refuse options that have no effect on a mesh."""
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.errors import UsageError

    if isinstance(shape, Mesh) and not options["scene"]:
        for name in ("viewpoint", "classifier"):
            if options[name]:
                raise UsageError(f"--{name} is about clouds, and {source} is a mesh: leave it out")


def _shape(
    source: str, data: Path, options: dict[str, Any]
) -> tuple[Shape, str, ObjectShape | None]:
    """Return a mesh or points (n, 3), a note and, of an object of the graph, what is known."""
    from grasp.push.inputs.sources import read_cloud
    from grasp.spatial.meshes.mesh_files import read_mesh
    from rtask.errors import UsageError

    path = Path(source)
    if path.is_file():
        if options["store"]:
            raise UsageError("--store needs an object of the graph, not a file")
        if is_mesh(path):
            mesh = read_mesh(path, options["scale"])
            x, y, z = (1000 * mesh.extent).tolist()
            return mesh, f"{len(mesh.faces)} faces, {x:.0f} x {y:.0f} x {z:.0f} mm", None
        points = options["scale"] * read_cloud(path)
        return points, f"{len(points)} points", None
    if not data.exists():
        if path.is_dir():
            raise UsageError(f"{source} is a folder; give a file in it")
        raise UsageError(f"{source}: no such file, and there is no knowledge base at {data}")
    from rtask.cli.connection import open_to_read
    from rtask.engine.engine import Engine
    from rtask.engine.records.shapes import object_shape

    with open_to_read(data) as kb, Engine(kb) as engine:
        stored_shape = object_shape(engine.context, source)
    return (
        stored_shape.points if stored_shape.mesh is None else stored_shape.mesh,
        stored_shape.note,
        stored_shape,
    )


def _planned(
    shape: Shape,
    stored_shape: ObjectShape | None,
    gripper: ParallelGripper | OtherHand,
    options: dict[str, Any],
) -> Proposals:
    import numpy as np

    from grasp.spatial.collision import Support, Surroundings
    from grasp.spatial.contact_plan import OtherHand
    from grasp.spatial.grasp_plan import SpatialOptions, plan_given, plan_on_cloud, plan_on_mesh
    from grasp.spatial.interchange import read_grasps
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.cli.grasping.other_hands import plan_with_contacts
    from rtask.errors import UsageError

    spatial_options = SpatialOptions(
        noise=_noise(options), samples=options["samples"], mass=options["mass"],
        seed=options["seed"],
        most=max(options["top"], 50),
    )  # fmt: skip
    if isinstance(gripper, OtherHand):
        return plan_with_contacts(shape, stored_shape, gripper, spatial_options, options)
    if options["grasps"] is not None and not isinstance(shape, Mesh):
        raise UsageError("--grasps needs the mesh that they are grasps of")
    if options["scene"]:
        return _in_scene(shape, gripper, options)
    if stored_shape is not None:
        return stored_shape.plan(
            gripper, spatial_options, _classifier(options), options["floating"]
        )
    points = shape.vertices if isinstance(shape, Mesh) else shape
    finite = points[np.isfinite(points).all(axis=1)] if len(points) else points
    support = None
    if len(finite) and not options["floating"]:
        support = Support(float(finite[:, 2].min()))
    if isinstance(shape, Mesh):
        if options["grasps"] is None:
            return plan_on_mesh(shape, gripper, Surroundings(support), spatial_options)
        given = read_grasps(options["grasps"], gripper, shape).candidates
        return plan_given(given, shape, gripper, Surroundings(support), spatial_options)
    eyes = options["viewpoint"]
    viewpoints = np.array(eyes) if eyes else None
    return plan_on_cloud(shape, gripper, support, viewpoints, spatial_options, _classifier(options))


def _in_scene(shape: Shape, gripper: ParallelGripper, options: dict[str, Any]) -> Proposals:
    """Plan on everything that a cloud with z up shows on its table."""
    from grasp.spatial.candidate import Proposals
    from grasp.spatial.scene_plan import SceneOptions
    from rtask.cli.grasping.other_hands import scene_view, things_in
    from rtask.engine.perception.clutter import plan_in_view

    view = scene_view(shape, options)
    if isinstance(view, str):
        return Proposals(reason=view)
    scene_options = SceneOptions(
        noise=_noise(options), samples=options["samples"], seed=options["seed"],
        most=max(options["top"], 50),
    )  # fmt: skip
    proposals = plan_in_view(view, gripper, scene_options)
    return replace(proposals, notes=(things_in(view), *proposals.notes))


def _classifier(options: dict[str, Any]) -> Filter:
    given: str | None = options["classifier"]
    if given is None or given == "shipped":
        return "shipped" if given else None
    from grasp.spatial.hand_search.classifier import GraspClassifier

    return GraspClassifier.load(Path(given))


def _noise(options: dict[str, Any]) -> Any:
    import math

    from grasp.spatial.scoring.confidence import PoseNoise

    usual = PoseNoise()
    position, rotation = options["position_std"], options["rotation_std_deg"]
    return PoseNoise(
        usual.position_std if position is None else position,
        usual.rotation_std if rotation is None else math.radians(rotation),
    )


def _store(
    data: Path, stored_shape: ObjectShape, proposals: Proposals, gripper: EndEffector,
    options: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    import rtask
    from rtask.engine.engine import Engine
    from rtask.engine.operations.planned import as_planned, store_planned_in_space
    from rtask.errors import UsageError

    least = options["min_confidence"]
    sure = [c for c in proposals if c.scores["confidence"] >= least][: options["top"]]
    if not sure:
        raise UsageError(f"nothing stored: {_verdict(proposals, options) or proposals.reason}")
    kind = options["gripper_type"] or gripper.gripper_type
    with rtask.open(data) as kb, Engine(kb) as engine:
        planned = as_planned(sure, _noise(options), options["samples"], gripper)
        return store_planned_in_space(
            engine.context,
            stored_shape.object_iri,
            planned,
            kind,
            derived_from=stored_shape.sources,
        )


def _draw(
    proposals: Proposals, gripper: EndEffector, shape: Shape, options: dict[str, Any]
) -> list[str]:
    from grasp.spatial.drawing import candidates_svg

    folder: Path = options["plots"]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "candidates_3d.svg"
    path.write_text(candidates_svg(proposals.candidates, gripper, shape), "utf-8")
    return [str(path)]


def _verdict(proposals: Proposals, options: dict[str, Any]) -> str:
    """Return why not to grasp, or ""."""
    if not proposals:
        advice = f"; {proposals.advice}" if proposals.advice else ""
        return f"no grasp found: {proposals.reason}{advice}"
    best = max(c.scores["confidence"] for c in proposals)
    if best < options["min_confidence"]:
        return f"no grasp found: the best confidence is {best:.2f} < {options['min_confidence']}"
    return ""


def _rows(proposals: Proposals, options: dict[str, Any]) -> list[dict[str, Any]]:
    from grasp.spatial.candidate import to_planar

    rows = []
    for rank, c in enumerate(proposals.candidates[: options["top"]], start=1):
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
    proposals: Proposals, gripper: EndEffector, notes: list[str], seconds: float,
    options: dict[str, Any],
) -> None:  # fmt: skip
    for note in notes:
        click.echo(note)
    click.echo(
        f"{gripper.name}, {_size(gripper)}, friction "
        f"{gripper.friction:g}: {len(proposals)} grasps, {options['samples']} poses each, "
        f"{seconds:.3f} s"
    )
    if proposals:
        held = "  lift  carry" if "carry" in proposals[0].scores else ""
        held += "  moves  thing" if "moves" in proposals[0].scores else ""
        click.echo(
            "rank   x, y, z mm             approach               width  s_G   95 %  epsilon" + held
        )
    for row in _rows(proposals, options):
        x, y, z = (1000 * v for v in row["position"])
        a, b, c = row["approach"]
        held = f"  {row['lift']:.2f}   {row['carry']:.2f}" if "carry" in row else ""
        held += f"  {row['moves']:.2f}   {row['segment']:5d}" if "moves" in row else ""
        click.echo(
            f"{row['rank']:4d}  ({x:6.1f},{y:6.1f},{z:6.1f})  ({a:+.2f},{b:+.2f},{c:+.2f})  "
            f"{1000 * row['width']:7.1f}  {row['confidence']:.2f}  {row['lower_95']:.2f}  "
            f"{row.get('epsilon', 0.0):7.4f}{held}{'  half' if row['antipodal'] == 'half' else ''}"
        )
    verdict = _verdict(proposals, options)
    if verdict:
        click.echo(verdict)
    click.echo("what happened:")
    for name, count in proposals.counts.items():
        click.echo(f"{count:8d}  {name}")


def _size(gripper: EndEffector) -> str:
    from grasp.spatial.suction_cup import SuctionCup

    if isinstance(gripper, SuctionCup):
        return f"lip {2000 * gripper.radius:.0f} mm wide, vacuum {gripper.force:.0f} N"
    return f"stroke {1000 * gripper.max_opening:.0f} mm"


def _as_json(
    proposals: Proposals, gripper: EndEffector, notes: list[str], seconds: float,
    options: dict[str, Any], stored: dict[str, Any] | None, drawings: list[str],
) -> dict[str, Any]:  # fmt: skip
    from grasp.messages import spatial_grasp_message

    rows = _rows(proposals, options)
    for row, candidate in zip(rows, proposals.candidates, strict=False):
        row["message"] = spatial_grasp_message(candidate, gripper, "object")
    return {
        "notes": notes,
        "gripper": gripper.name,
        "seconds": seconds,
        "verdict": _verdict(proposals, options),
        "grasps": rows,
        "counts": dict(proposals.counts),
        "stored": stored,
        "drawings": drawings,
    }
