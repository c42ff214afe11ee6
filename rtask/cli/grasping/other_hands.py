"""``rtask grasp plan`` in space with a suction cup or three fingers."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.collision import Support
    from grasp.spatial.contact_plan import OtherHand
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.engine.perception.clutter import ClutterView
    from rtask.engine.records.shapes import ObjectShape

    Shape = Mesh | NDArray[np.float64]

__all__ = ["plan_with_contacts", "scene_view", "things_in"]


def plan_with_contacts(
    shape: Shape,
    stored: ObjectShape | None,
    hand: OtherHand,
    spatial_options: SpatialOptions,
    options: dict[str, Any],
) -> Proposals:
    """Plan where a hand takes a mesh, what a cloud shows, or any thing of a scene."""
    from grasp.spatial.collision import Surroundings
    from grasp.spatial.contact_plan import plan_contacts, plan_contacts_on_cloud
    from grasp.spatial.meshes.mesh import Mesh

    what = "a suction cup" if hand.contact_kind == "suction" else "three fingers"
    _refuse_for(options, ("grasps", "save_grasps", "classifier"), what)
    if options["scene"]:
        return _on_scene(shape, options, hand, spatial_options)
    support, viewpoints = _standing(shape, stored, options)
    if isinstance(shape, Mesh):
        return plan_contacts(shape, hand, Surroundings(support), spatial_options)
    return plan_contacts_on_cloud(shape, hand, support, viewpoints, spatial_options)


def _on_scene(
    shape: Shape, options: dict[str, Any], hand: OtherHand, spatial_options: SpatialOptions
) -> Proposals:
    """Plan on all things that a cloud shows on its table."""
    import numpy as np

    from grasp.spatial.candidate import Proposals
    from grasp.spatial.collision import Support
    from grasp.spatial.contact_plan import plan_contacts_on_scene

    view = scene_view(shape, options)
    if isinstance(view, str):
        return Proposals(reason=view)
    eyes = np.array(options["viewpoint"])
    support = Support(view.table_height)
    proposals = plan_contacts_on_scene(
        view.points, view.labels, hand, support, eyes, spatial_options
    )
    return replace(proposals, notes=(things_in(view), *proposals.notes))


def _refuse_for(options: dict[str, Any], names: tuple[str, ...], what: str) -> None:
    from rtask.errors import UsageError

    for name in names:
        if options[name]:
            raise UsageError(
                f"--{name.replace('_', '-')} is for grippers with two jaws, not {what}"
            )


def _standing(
    shape: Shape, stored: ObjectShape | None, options: dict[str, Any]
) -> tuple[Support | None, NDArray[np.float64] | None]:
    """Return what an object stands on, and where the cameras were that saw it."""
    import numpy as np

    from grasp.spatial.collision import Support
    from grasp.spatial.meshes.mesh import Mesh

    points = shape.vertices if isinstance(shape, Mesh) else shape
    finite = points[np.isfinite(points).all(axis=1)] if len(points) else points
    support = None
    if len(finite) and not options["floating"]:
        support = Support(0.0 if stored is not None else float(finite[:, 2].min()))
    viewpoints = np.array(options["viewpoint"]) if options["viewpoint"] else None
    if stored is not None and len(stored.viewpoints):
        viewpoints = stored.viewpoints
    return support, viewpoints


def scene_view(shape: Shape, options: dict[str, Any]) -> ClutterView | str:
    """Return what a cloud with z up shows on its table, or why it shows nothing."""
    import numpy as np

    from features.geometry import look_at, transform
    from grasp.spatial.meshes.mesh import Mesh
    from rtask.engine.perception.clutter import view_clutter
    from rtask.errors import UsageError

    if isinstance(shape, Mesh):
        raise UsageError("--mode scene needs the cloud of a table, not a mesh")
    if len(options["viewpoint"]) != 1:
        raise UsageError("--mode scene needs one --viewpoint: the place of the camera, in m")
    (eye,) = options["viewpoint"]
    finite = shape[np.isfinite(shape).all(axis=1)]
    if not len(finite):
        return "the cloud holds no finite point"
    frame_from_camera = look_at(np.array(eye), np.median(finite, axis=0))
    view = view_clutter(
        transform(np.linalg.inv(frame_from_camera), finite), None, frame_from_camera
    )
    return view or "no table: no level plane below the camera is large enough"


def things_in(view: ClutterView) -> str:
    return f"{len(view.segments)} things on a table at {1000 * view.table_height:.0f} mm"
