"""Bodies of products in a physics client: single ones, and ones with a part that breaks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from simulate.world.hidden import Part
from simulate.world.objects import Assets, ObjectSpec, collision_of, inertia_of

__all__ = ["break_part", "breakable_parts", "create_object", "mass_offset"]

_LOOSE_SHARE = 0.9
"""Of the mass of a product with a loose weight, how much is loose."""
_PART_KG = 1e-4
"""Of a part beside the first, which carries the mass: Bullet takes links without mass as fixed."""


def create_object(client: Any, spec: ObjectSpec, assets: Assets | None) -> int:
    """Create a dynamic body of a product; return it."""
    parts = spec.secret.parts
    visual = _visual(client, spec, assets)
    if spec.secret.travel_m:
        body = _body_with_weight(client, spec, visual)
    elif parts:
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
    # Bullet takes a link's friction for that of the base where it comes with damping or activation.
    client.changeDynamics(
        body,
        -1,
        linearDamping=spec.friction.linear_damping,
        angularDamping=spec.friction.angular_damping,
        activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
        localInertiaDiagonal=inertia,
    )
    surfaces = [part.lateral for part in parts] or [None]
    for link, lateral in enumerate(surfaces, start=-1):
        client.changeDynamics(
            body,
            link,
            lateralFriction=spec.friction.lateral if lateral is None else lateral,
            spinningFriction=spec.friction.spinning,
            rollingFriction=spec.friction.rolling,
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


def _body_with_weight(client: Any, spec: ObjectSpec, visual: int) -> int:
    """Create a body in which a weight slides along x without friction."""
    travel, loose = abs(spec.secret.travel_m), _LOOSE_SHARE * spec.mass
    collision = client.createCollisionShapeArray(**_columns(client, collision_of(spec)))
    still = [0.0, 0.0, 0.0, 1.0]
    body = int(
        client.createMultiBody(
            spec.mass - loose, collision, visual,
            linkMasses=[loose], linkCollisionShapeIndices=[-1], linkVisualShapeIndices=[-1],
            linkPositions=[[0.0, 0.0, 0.0]], linkOrientations=[still],
            linkInertialFramePositions=[[0.0, 0.0, 0.0]], linkInertialFrameOrientations=[still],
            linkParentIndices=[0], linkJointTypes=[client.JOINT_PRISMATIC],
            linkJointAxis=[[1.0, 0.0, 0.0]],
        )
    )  # fmt: skip
    client.changeDynamics(body, 0, jointLowerLimit=-travel, jointUpperLimit=travel)
    client.setJointMotorControl2(body, 0, client.VELOCITY_CONTROL, force=0.0)
    client.resetJointState(body, 0, spec.secret.travel_m)
    return body
