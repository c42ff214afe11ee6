"""Bodies of products in a physics client: single ones, and ones with a part that breaks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simulate.world.hidden import Part
from simulate.world.objects import Assets, ObjectSpec, collision_of, inertia_of

__all__ = ["break_part", "breakable_parts", "create_object", "mass_offset"]

_PART_KG = 1e-4
"""Of a part beside the first, which carries the mass: Bullet takes links without mass as fixed."""


def create_object(client: Any, spec: ObjectSpec, assets: Assets | None) -> int:
    """Create a dynamic body of a product; return it."""
    parts = spec.secret.parts
    visual = _visual(client, spec, assets)
    if parts:
        body = _body_of_parts(client, spec, parts, visual)
    else:
        shapes = assets.collision if assets is not None else collision_of(spec)
        collision = client.createCollisionShapeArray(**_columns(client, shapes))
        body = int(
            client.createMultiBody(
                spec.mass, collision, visual, baseInertialFramePosition=mass_offset(spec)
            )
        )
    inertia = inertia_of(collision_of(spec), spec.mass) if assets is None else assets.inertia
    for link in range(-1, max(len(parts), 1) - 1):
        client.changeDynamics(
            body,
            link,
            lateralFriction=spec.friction.lateral,
            spinningFriction=spec.friction.spinning,
            rollingFriction=spec.friction.rolling,
            linearDamping=spec.friction.linear_damping,
            angularDamping=spec.friction.angular_damping,
            activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
            **({"localInertiaDiagonal": inertia} if link == -1 else {}),
        )
    return body


def mass_offset(spec: ObjectSpec) -> tuple[float, float, float]:
    """Return the centre of mass in the body frame, m."""
    return spec.secret.mass_offset_m, 0.0, 0.0


def breakable_parts(spec: ObjectSpec) -> dict[int, float]:
    """Return the links of a product that break, each with the force of a contact (N) at which."""
    return {
        number - 1: part.breaks_at_n
        for number, part in enumerate(spec.secret.parts)
        if part.breaks_at_n < float("inf")
    }


def break_part(client: Any, body: int, link: int, stays_on: Sequence[int]) -> None:
    """Let a part give way to everything but the bodies that it stands on."""
    client.setCollisionFilterGroupMask(body, link, 0, 0)
    for other in stays_on:
        client.setCollisionFilterPair(body, other, link, -1, 1)


def _columns(client: Any, shapes: Sequence[Any]) -> dict[str, list[Any]]:
    kinds = {"box": client.GEOM_BOX, "sphere": client.GEOM_SPHERE, "cylinder": client.GEOM_CYLINDER}
    return {
        "shapeTypes": [kinds[shape.shape] for shape in shapes],
        "halfExtents": [[v / 2 for v in s.size] if s.shape == "box" else [] for s in shapes],
        "radii": [s.size[0] if s.shape != "box" else 0.0 for s in shapes],
        "lengths": [s.size[1] if s.shape == "cylinder" else 0.0 for s in shapes],
        "collisionFramePositions": [s.position for s in shapes],
        "collisionFrameOrientations": [s.orientation for s in shapes],
    }


def _visual(client: Any, spec: ObjectSpec, assets: Assets | None) -> int:
    if assets is not None:
        # The print comes with the mesh's material; loaded once more it mixes up OpenGL's textures.
        return int(client.createVisualShape(client.GEOM_MESH, fileName=str(assets.obj_path)))
    columns = _columns(client, collision_of(spec))
    columns["visualFramePositions"] = columns.pop("collisionFramePositions")
    columns["visualFrameOrientations"] = columns.pop("collisionFrameOrientations")
    return int(client.createVisualShapeArray(**columns))


def _body_of_parts(client: Any, spec: ObjectSpec, parts: Sequence[Part], visual: int) -> int:
    """Create a body with one link for each part but the first."""
    boxes = [
        client.createCollisionShape(
            client.GEOM_BOX, halfExtents=[v / 2 for v in part.size],
            collisionFramePosition=part.position,
        )
        for part in parts
    ]  # fmt: skip
    more = len(parts) - 1
    still = [0.0, 0.0, 0.0, 1.0]
    return int(
        client.createMultiBody(
            spec.mass, boxes[0], visual, baseInertialFramePosition=mass_offset(spec),
            linkMasses=[_PART_KG] * more,
            linkCollisionShapeIndices=boxes[1:],
            linkVisualShapeIndices=[-1] * more,
            linkPositions=[[0.0, 0.0, 0.0]] * more,
            linkOrientations=[still] * more,
            linkInertialFramePositions=[[0.0, 0.0, 0.0]] * more,
            linkInertialFrameOrientations=[still] * more,
            linkParentIndices=[0] * more,
            linkJointTypes=[client.JOINT_FIXED] * more,
            linkJointAxis=[[0.0, 0.0, 1.0]] * more,
        )
    )  # fmt: skip
