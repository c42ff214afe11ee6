"""Writer of URDF files.

Apart from meshes of the user's own installation, only boxes, spheres and cylinders are written:
``<capsule>`` is an extension of one reader and causes errors in others. Sensor frames are written
on request, as links without mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from xml.sax.saxutils import quoteattr

from simulate.robots.description import Inertial, Joint, Link, Pose, RobotDescription, Shape

__all__ = ["urdf_text"]


def urdf_text(robot: RobotDescription, *, frames: bool = False) -> str:
    """Return the URDF document of a robot.

    Parameters
    ----------
    robot
        The description.
    frames
        Also write the sensor frames, as massless links on fixed joints. A physics engine needs
        none of them, so the simulated body goes without.

    Examples
    --------
    >>> from simulate.robots.nao import describe_nao
    >>> urdf_text(describe_nao()).splitlines()[1]
    '<robot name="nao">'
    """
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>"]
    for link in robot.links:
        lines += _link(link)
    for joint in robot.joints:
        lines += _joint(joint)
    if frames:
        for name, (parent, pose) in robot.frames.items():
            lines.append(f"  <link name={quoteattr(name)}/>")
            lines += _joint(Joint(f"{name}_fixed", parent, name, pose, kind="fixed"))
    return "\n".join([*lines, "</robot>", ""])


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _origin(pose: Pose) -> str:
    return f'<origin xyz="{_numbers(pose.xyz)}" rpy="{_numbers(pose.rpy)}"/>'


def _link(link: Link) -> Iterator[str]:
    yield f"  <link name={quoteattr(link.name)}>"
    yield from _inertial(link.inertial)
    colour = _numbers(link.colour)
    for shape in link.shapes:
        geometry = _geometry(shape)
        material = f'<material name="{link.name}_paint"><color rgba="{colour}"/></material>'
        yield f"    <visual>{_origin(shape.pose)}{geometry}{material}</visual>"
        yield f"    <collision>{_origin(shape.pose)}{geometry}</collision>"
    yield "  </link>"


def _inertial(inertial: Inertial) -> Iterator[str]:
    (xx, yy, zz), (xy, xz, yz) = inertial.diagonal, inertial.off_diagonal
    yield f'    <inertial><origin xyz="{_numbers(inertial.centre)}" rpy="0 0 0"/>'
    yield f'      <mass value="{inertial.mass:.9g}"/>'
    yield (
        f'      <inertia ixx="{xx:.9g}" ixy="{xy:.9g}" ixz="{xz:.9g}" '
        f'iyy="{yy:.9g}" iyz="{yz:.9g}" izz="{zz:.9g}"/></inertial>'
    )


def _geometry(shape: Shape) -> str:
    if shape.kind == "box":
        inner = f'<box size="{_numbers(shape.size)}"/>'
    elif shape.kind == "mesh":
        inner = f'<mesh filename={quoteattr(shape.path)} scale="{_numbers(shape.size)}"/>'
    elif shape.kind == "sphere":
        inner = f'<sphere radius="{shape.size[0]:.9g}"/>'
    else:
        inner = f'<cylinder radius="{shape.size[0]:.9g}" length="{shape.size[1]:.9g}"/>'
    return f"<geometry>{inner}</geometry>"


def _joint(joint: Joint) -> Iterator[str]:
    yield f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">'
    yield f"    {_origin(joint.pose)}"
    yield f"    <parent link={quoteattr(joint.parent)}/><child link={quoteattr(joint.child)}/>"
    if joint.kind != "fixed":
        yield f'    <axis xyz="{_numbers(joint.axis)}"/>'
        yield (
            f'    <limit lower="{joint.lower:.9g}" upper="{joint.upper:.9g}" '
            f'velocity="{joint.velocity:.9g}" effort="{joint.effort:.9g}"/>'
        )
        if joint.mimic is not None:
            source, factor = joint.mimic
            yield (
                f'    <mimic joint="{source}" multiplier="{factor:.9g}" '
                f'offset="{joint.mimic_offset:.9g}"/>'
            )
    yield "  </joint>"
