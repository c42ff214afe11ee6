"""``rtask grasp scene``: grasps in space of all objects that a cloud shows on a table."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.grasping.planning import errors_name
from rtask.cli.grasping.space_report import report
from rtask.cli.grasping.spatial import SpatialCall, pose_options, result_options
from rtask.cli.options import exit_if_empty, json_option, limit_option
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.gripper import EndEffector
    from rtask.engine.perception.clutter import ClutterView

__all__ = ["scene"]


@dataclass(frozen=True, kw_only=True)
class _SceneCall(SpatialCall):
    """Options of ``rtask grasp scene``; see its help."""

    viewpoint: tuple[float, float, float]

    def __post_init__(self) -> None:
        import math

        super().__post_init__()
        if not all(map(math.isfinite, self.viewpoint)):
            place = " ".join(map(str, self.viewpoint))
            raise UsageError(f"--viewpoint {place}: expected numbers, m")


@click.command()
@click.argument("cloud", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option(
    "--viewpoint",
    type=(float, float, float),
    metavar="X Y Z",
    required=True,
    help="Position of the camera, m.",
)
@click.option(
    "--gripper",
    default="panda",
    show_default=True,
    help="nao, panda, jaw:STROKE, suction:RADIUS or three:OPENING in m, or a file that describes "
    "one: JSON, TOML or URDF.",
)
@click.option(
    "--friction", type=float, help="Between jaw and object.  [default: that of the gripper]"
)
@click.option("--mass", type=float, help="Mass of each object, kg; not for two jaws.")
@click.option("--scale", default=1.0, show_default=True, help="m per unit of the file.")
@pose_options
@limit_option(10, "Number of grasps to print.")
@result_options
@json_option
def scene(cloud: Path, as_json: bool, **options: Any) -> None:
    """Rank grasps of all objects on the table of CLOUD. Exit code 1 if there are none.

    CLOUD (.pcd, .ply, .npy, .xyz; z up) shows a table with objects, seen from one place. Grasps are
    ranked by their confidence under an uncertain pose; lengths are in m.
    """
    from grasp.push.inputs.sources import read_cloud
    from grasp.spatial.meshes.mesh_files import is_mesh

    with errors_name(str(cloud)), announce_compilation():
        call = _SceneCall(**options)
        hand = call.end_effector()
        if is_mesh(cloud):
            raise UsageError(f"{cloud} is a mesh; a scene is the cloud of a table")
        points = call.scale * read_cloud(cloud)
        began = time.perf_counter()
        with Working("planning"):
            proposals = _planned(points, hand, call)
        seconds = time.perf_counter() - began
        note = f"{len(points)} points"
        reported = report(proposals, hand, points, call, as_json, note, cloud.name, seconds, None)
    exit_if_empty(reported)


def _planned(points: NDArray[np.float64], hand: EndEffector, call: _SceneCall) -> Proposals:
    from grasp.spatial.candidate import Proposals
    from grasp.spatial.contact_plan import OtherHand
    from grasp.spatial.gripper import ParallelGripper
    from grasp.spatial.scene_plan import SceneOptions
    from rtask.engine.perception.clutter import plan_in_view

    if isinstance(hand, OtherHand):
        call.refuse_for_contacts(hand)
    elif call.mass is not None:
        raise UsageError("--mass has no effect on the grasps of two jaws in a scene: leave it out")
    view = _view(points, call)
    if isinstance(view, str):
        return Proposals(reason=view)
    if isinstance(hand, OtherHand):
        proposals = _plan_contacts(view, hand, call)
    else:
        assert isinstance(hand, ParallelGripper)
        options = SceneOptions(
            noise=call.noise, samples=call.samples, seed=call.seed, most=call.most
        )
        proposals = plan_in_view(view, hand, options)
    height_mm = 1000 * view.table_height
    note = f"{len(view.segments)} objects on a table at {height_mm:.0f} mm"
    return replace(proposals, notes=(note, *proposals.notes))


def _plan_contacts(view: ClutterView, hand: Any, call: _SceneCall) -> Proposals:
    import numpy as np

    from grasp.spatial.collision import Support
    from grasp.spatial.contact_plan import plan_contacts_on_scene
    from grasp.spatial.grasp_plan import SpatialOptions

    options = SpatialOptions(
        noise=call.noise, samples=call.samples, mass=call.mass, seed=call.seed, most=call.most
    )
    eyes = np.array([call.viewpoint])
    support = Support(view.table_height)
    return plan_contacts_on_scene(view.points, view.labels, hand, support, eyes, options)


def _view(points: NDArray[np.float64], call: _SceneCall) -> ClutterView | str:
    """Return what a cloud with z up shows on its table, or why it shows nothing."""
    import numpy as np

    from features.geometry import look_at, transform
    from rtask.engine.perception.clutter import view_clutter

    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return "the cloud holds no finite point"
    frame_from_camera = look_at(np.array(call.viewpoint), np.median(finite, axis=0))
    view = view_clutter(
        transform(np.linalg.inv(frame_from_camera), finite), None, frame_from_camera
    )
    return view or "no table: no level plane below the camera is large enough"
