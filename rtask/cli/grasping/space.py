"""``rtask grasp space``: grasps in space of a mesh, a cloud, or an object of the graph."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.grasping.planning import errors_name
from rtask.cli.grasping.space_report import report, verdict
from rtask.cli.grasping.spatial import SpatialCall, pose_options, result_options
from rtask.cli.options import data_option, exit_if_empty, json_option, limit_option
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.collision import Support
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.hand_search.shipped import Filter
    from grasp.spatial.meshes.mesh import Mesh
    from grasp.spatial.scoring.promises import Promises
    from rtask.engine.records.shapes import ObjectShape

    Shape = Mesh | NDArray[np.float64]

__all__ = ["space"]


@dataclass(frozen=True, kw_only=True)
class _SpaceCall(SpatialCall):
    """Options of ``rtask grasp space``; see its help."""

    gripper_type: str | None
    floating: bool
    part: int | None
    viewpoint: tuple[tuple[float, float, float], ...]
    grasps: Path | None
    classifier: str | None
    shapes: int | None
    outcomes: Path | None
    store: bool

    def __post_init__(self) -> None:
        import math

        super().__post_init__()
        for place in self.viewpoint:
            if not all(map(math.isfinite, place)):
                raise UsageError(f"--viewpoint {' '.join(map(str, place))}: expected numbers, m")
        if self.shapes and self.classifier:
            raise UsageError("--shapes and --classifier both rank grasps: leave one of them out")

    def refuse(self, why: str, *names: str) -> None:
        """Refuse options that have no effect on a kind of source."""
        for name in names:
            if getattr(self, name):
                raise UsageError(f"--{name} {why}: leave it out")

    def planning(self, grown: Promises | None = None) -> SpatialOptions:
        """Return the options of the planner; ``grown`` are promises from outcomes in the graph."""
        from grasp.spatial.grasp_plan import SpatialOptions

        options = SpatialOptions(
            noise=self.noise, samples=self.samples, mass=self.mass, seed=self.seed, most=self.most,
            find_support=not self.floating, promises=self.promises(grown),
        )  # fmt: skip
        return options if self.shapes is None else replace(options, shapes=self.shapes)

    def promises(self, grown: Promises | None = None) -> Promises | None:
        """Return what the hand's own outcomes teach: those of a file, else those in the graph."""
        if self.outcomes is None:
            return grown
        from grasp.spatial.gripper import ParallelGripper
        from grasp.spatial.scoring.outcome_files import read_outcomes
        from grasp.spatial.scoring.promises import Promises

        hand = self.end_effector()
        if not isinstance(hand, ParallelGripper):
            raise UsageError(f"--outcomes is about jaws, and {hand.name} has none: leave it out")
        return Promises.by(hand).after(read_outcomes(self.outcomes))

    def filter(self) -> Filter:
        """Return the classifier of grasps of clouds, if one is asked for."""
        if not self.classifier:
            return None
        if self.classifier == "shipped":
            return "shipped"
        from grasp.spatial.hand_search.classifier import GraspClassifier

        return GraspClassifier.load(Path(self.classifier))


@click.command()
@click.argument("source")
@click.option(
    "--gripper",
    default="panda",
    show_default=True,
    help="nao, panda, jaw:STROKE, suction:RADIUS or three:OPENING in m, or a file that describes "
    "one: JSON, TOML or URDF.",
)
@click.option(
    "--gripper-type",
    help="Name under which stored grasps are found again.  [default: that of the gripper]",
)
@click.option(
    "--friction", type=float, help="Between jaw and object.  [default: that of the gripper]"
)
@click.option("--mass", type=float, help="Mass of the object to hold, kg.")
@click.option("--scale", default=1.0, show_default=True, help="m per unit of the file.")
@click.option("--floating", is_flag=True, help="There is no table under the object.")
@click.option("--part", type=click.IntRange(min=1),
    help="Which body of a mesh whose bodies lie apart, the largest first.  [default: 1]",
)  # fmt: skip
@click.option(
    "--viewpoint",
    type=(float, float, float),
    metavar="X Y Z",
    multiple=True,
    help="Position of the camera, m, once for each view in the cloud; the hidden side is then "
    "completed.",
)
@click.option(
    "--grasps",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Rank the grasps of this HDF5 file (ACRONYM's layout) of a mesh instead of own.",
)
@click.option(
    "--classifier",
    metavar="FILE",
    help="A filter of grasps of clouds: a model made by `rtask grasp train`, or shipped for the "
    "one that comes with rtask for the hand.  [default: none]",
)
@click.option(
    "--shapes",
    type=click.IntRange(0, 500),
    help="Samples of the shape that no camera saw, over which grasps of a cloud are ranked; they "
    "need --viewpoint. 0 = ranked on one guess of it.  [default: 0]",
)
@click.option(
    "--outcomes",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Own outcomes of the hand on meshes, one JSON object a line: lift, carry and load of the "
    "grasp as printed by --json, lifted and carried true or false. Promises follow them.",
)
@pose_options
@limit_option(10, "Number of grasps to print, and to store.")
@result_options
@click.option("--store", is_flag=True, help="Store the best grasps with the object in the graph.")
@data_option
@json_option
def space(source: str, data: Path, as_json: bool, **options: Any) -> None:
    """Rank grasps of SOURCE in space. Exit code 1 if there are none.

    SOURCE is a mesh (.stl, .obj, .ply; z up), a segmented point cloud (.pcd, .ply, .npy, .xyz; z
    up), or the IRI, id or name of an object in the graph. Grasps are ranked by their confidence
    under an uncertain pose; lengths are in m. For meshes, lift and carry are the chances that the
    hand lifts the object and still holds it when shaken; for objects of the graph they follow the
    outcomes of such hands that are stored there, see --outcomes.
    """
    with errors_name(source), announce_compilation():
        call = _SpaceCall(**options)
        hand = call.end_effector()
        shape, note, stored_shape, grown = _shape(source, data, call)
        began = time.perf_counter()
        with Working("planning"):
            proposals = _planned(shape, stored_shape, hand, call, grown)
        seconds = time.perf_counter() - began
        stored = None
        if call.store and stored_shape is not None:
            stored = _store(data, stored_shape, proposals, hand, call)
        name = Path(source).name if stored_shape is None else source
        reported = report(proposals, hand, shape, call, as_json, note, name, seconds, stored)
    exit_if_empty(reported)


def _shape(
    source: str, data: Path, call: _SpaceCall
) -> tuple[Shape, str, ObjectShape | None, Promises | None]:
    """Return a mesh or points (n, 3), a line about it, and what the graph has of an object.

    The latter is its shape, and what is promised after the outcomes of hands of the given type.
    """
    from grasp.push.inputs.sources import read_cloud
    from grasp.spatial.meshes.mesh_files import is_mesh, read_mesh

    path = Path(source)
    if not path.is_file():
        stored_shape, grown = _object(source, data, call)
        call.refuse(f"is about files, and {source} is an object", "viewpoint", "grasps", "part")
        if stored_shape.mesh is None:
            call.refuse(f"is about meshes, and {source} has a cloud", "outcomes")
        if stored_shape.mesh is None:
            return stored_shape.points, stored_shape.note, stored_shape, None
        note = stored_shape.note
        if grown is not None and grown.outcomes and call.outcomes is None:
            of = "outcome" if grown.outcomes == 1 else "outcomes"
            note += f"; promises follow {grown.outcomes} {of} of such hands in the graph"
        return stored_shape.mesh, note, stored_shape, grown
    if call.store:
        raise UsageError("--store needs an object of the graph, not a file")
    if is_mesh(path):
        call.refuse(f"is about clouds, and {path} is a mesh", "viewpoint", "classifier", "shapes")
        mesh, others = _body(read_mesh(path, call.scale), path, call)
        return mesh, f"{len(mesh.faces)} faces, {_size(mesh)}{others}", None, None
    call.refuse(f"needs the mesh that they are grasps of, and {path} is a cloud", "grasps")
    call.refuse(f"is about meshes, and {path} is a cloud", "part", "outcomes")
    points = call.scale * read_cloud(path)
    return points, f"{len(points)} points", None, None


def _body(mesh: Mesh, path: Path, call: _SpaceCall) -> tuple[Mesh, str]:
    """Return the body of a file to plan for, and what else the file holds, for people."""
    from grasp.spatial.meshes.bodies import bodies_apart

    bodies = bodies_apart(mesh)
    number = call.part or 1
    if number > len(bodies):
        raise UsageError(
            f"--part {number}: the bodies of {path} that lie apart number {len(bodies)}"
        )
    others = [f"{k} is {_size(body)}" for k, body in enumerate(bodies, start=1) if k != number]
    if not others:
        return mesh, ""
    more = f" and {len(others) - 3} more" if len(others) > 3 else ""
    hint = f"; of {len(bodies)} bodies that lie apart: --part {', --part '.join(others[:3])}{more}"
    return bodies[number - 1], hint


def _size(mesh: Mesh) -> str:
    x, y, z = (1000 * mesh.extent).tolist()
    return f"{x:.0f} x {y:.0f} x {z:.0f} mm"


def _planned(
    shape: Shape,
    stored_shape: ObjectShape | None,
    hand: EndEffector,
    call: _SpaceCall,
    grown: Promises | None,
) -> Proposals:
    from grasp.spatial.meshes.mesh import Mesh

    if hand.contact_kind != "jaws":
        call.refuse_for_contacts(hand, "classifier", "shapes")
    if stored_shape is not None:
        return stored_shape.plan(hand, call.planning(grown), call.filter(), call.floating)
    if isinstance(shape, Mesh):
        return _plan_mesh(shape, hand, call)
    return _plan_cloud(shape, hand, call)


def _plan_mesh(mesh: Mesh, hand: EndEffector, call: _SpaceCall) -> Proposals:
    from grasp.spatial.collision import Surroundings
    from grasp.spatial.contact_plan import OtherHand, plan_contacts
    from grasp.spatial.grasp_plan import plan_given, plan_on_mesh
    from grasp.spatial.gripper import ParallelGripper
    from grasp.spatial.interchange import read_grasps, read_poses

    around = Surroundings(_support(mesh.vertices, call))
    if isinstance(hand, OtherHand):
        given = None if call.grasps is None else read_poses(call.grasps, hand)
        return plan_contacts(mesh, hand, around, call.planning(), given)
    assert isinstance(hand, ParallelGripper)
    if call.grasps is None:
        return plan_on_mesh(mesh, hand, around, call.planning())
    own = read_grasps(call.grasps, hand, mesh).candidates
    return plan_given(own, mesh, hand, around, call.planning())


def _plan_cloud(points: NDArray[np.float64], hand: EndEffector, call: _SpaceCall) -> Proposals:
    import numpy as np

    from grasp.spatial.clouds.ground import find_support
    from grasp.spatial.contact_plan import OtherHand, plan_contacts_on_cloud
    from grasp.spatial.grasp_plan import plan_on_cloud
    from grasp.spatial.gripper import ParallelGripper

    eyes = np.array(call.viewpoint) if call.viewpoint else None
    shown = None if call.floating else find_support(points)
    # Without a table in it, a cloud with z up stands on its lowest point.
    support = _support(points, call) if shown is None else None
    if isinstance(hand, OtherHand):
        return plan_contacts_on_cloud(points, hand, support, eyes, call.planning())
    assert isinstance(hand, ParallelGripper)
    return plan_on_cloud(points, hand, support, eyes, call.planning(), call.filter())


def _support(points: NDArray[np.float64], call: _SpaceCall) -> Support | None:
    """Return the table under points (n, 3) with z up: at the lowest of them."""
    import numpy as np

    from grasp.spatial.collision import Support

    finite = points[np.isfinite(points).all(axis=1)] if len(points) else points
    if call.floating or not len(finite):
        return None
    return Support(float(finite[:, 2].min()))


def _object(source: str, data: Path, call: _SpaceCall) -> tuple[ObjectShape, Promises | None]:
    """Return the best stored shape of an object of the graph, and promises by its outcomes."""
    if not data.exists():
        if Path(source).is_dir():
            raise UsageError(f"{source} is a folder; give a file in it")
        raise UsageError(f"{source}: no such file, and there is no knowledge base at {data}")
    from rtask.cli.connection import open_to_read
    from rtask.cli.things import name_or_iri
    from rtask.engine.engine import Engine
    from rtask.engine.memory.promises import grown_promises, hands_of_type
    from rtask.engine.records.shapes import object_shape

    with open_to_read(data) as kb, Engine(kb) as engine:
        shape = object_shape(engine.context, name_or_iri(source, data))
        hand = call.end_effector()
        hands = hands_of_type(engine.context, call.gripper_type or hand.gripper_type)
        return shape, grown_promises(engine.context, hand, hands)


def _store(
    data: Path, stored_shape: ObjectShape, proposals: Proposals, hand: EndEffector, call: _SpaceCall
) -> dict[str, Any]:
    from rtask.cli.connection import open_to_change
    from rtask.engine.engine import Engine
    from rtask.engine.operations.planned import as_planned, store_planned_in_space

    sure = [c for c in proposals if c.scores["confidence"] >= call.min_confidence][: call.limit]
    if not sure:
        raise UsageError(f"nothing stored: {verdict(proposals, call) or proposals.reason}")
    with open_to_change(data) as kb, Engine(kb) as engine:
        return store_planned_in_space(
            engine.context,
            stored_shape.object_iri,
            as_planned(sure, call.noise, call.samples, hand),
            call.gripper_type or hand.gripper_type,
            derived_from=stored_shape.sources,
        )
