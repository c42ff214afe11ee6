"""Object M of Kehoe 2014, 3.7: lying on the robot's table, imaged, contoured and planned on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import Intrinsics
from grasp.push import PushTest, Tolerance, plan_push_grasps
from grasp.push.inputs.contours import rings_from_image
from grasp.push.inputs.sources import Outline, without_details
from grasp.push.parts import OBJECT_M, stand_in
from grasp.push.polygon import as_polygon, centroid, triangles
from grasp.push.push_plan import PushPlan
from grasp.push.trials import Trials
from rtask.scratch import ScratchFolder
from simulate.grasping.executor import Workcell
from simulate.grasping.floating.execution import spawn_parts
from simulate.grasping.push_grasping import ArmPush
from simulate.robots.description import Floats
from simulate.study.quality.objects import GraspObject
from simulate.world.camera import Camera, Lighting
from simulate.world.objects import Friction

__all__ = [
    "ARM",
    "HEIGHT_M",
    "JAW_M",
    "PUBLISHED",
    "TRUE_COM",
    "PlaneBody",
    "arm_push",
    "chosen",
    "first_contact",
    "image_of",
    "lay",
    "plan_from_image",
    "plug",
    "printed",
    "to_pixels",
]

ARM = "panda_arm"
PUBLISHED = ((84.4, 5), (54.5, 5), (23.3, 0))
"""Quality, %, of the thesis's three grasps, and how many of five trials closed."""
HEIGHT_M = 0.025
JAW_M = 0.0175
"""Width of the Panda's fingertips where they meet the part: their mesh tapers from 21 mm."""
FRICTION = 0.7
_FINGER_FRICTION = 1.2
_MASS_KG, TRUE_COM = 0.06, 0.08
"""The plug's prong is brass: its centre of mass is .08 radii nearer to it than the centroid."""
_PLACE, _YAW = (0.46, 0.0), 0.5
_ABOVE_M, _FOV_RAD = 0.60, 0.30
_SAMPLES, _DENSITY = 400, 10.0
_GAP_M, _TRAVEL_M, _ROOM_M = 0.008, 0.040, 0.006
"""Before the nominal contact and beyond it, and free beside the jaws."""
_FIRST_PRINT = 1_000_000
"""Number of the first perturbation that is printed: planning uses those from 0 on."""


@dataclass(frozen=True)
class PlaneBody:
    """An extruded part on the table.

    Parameters
    ----------
    ring : (n, 2), m
        Outline, base frame.
    com : (2,), m
        Where its weight acts.
    """

    ring: Floats
    com: Floats


def plug(com_share: float = TRUE_COM) -> PlaneBody:
    """Return the plug where it lies.

    Parameters
    ----------
    com_share
        Distance of its true centre of mass from its centroid towards the prong, over its radius.
    """
    ring = stand_in(OBJECT_M) / 1000.0
    middle = centroid(ring)
    radius = float(np.linalg.norm(ring - middle, axis=1).max())
    c, s = math.cos(_YAW), math.sin(_YAW)
    turn = np.array([[c, -s], [s, c]])
    com = np.array([com_share * radius, 0.0])
    return PlaneBody((ring - middle) @ turn.T + _PLACE, turn @ com + _PLACE)


def lay(cell: Workcell, part: PlaneBody) -> int:
    """Put an extruded part on the table, as convex prisms; return the body."""
    prisms = []
    for flat in triangles(part.ring):
        low = np.column_stack([flat - part.com, np.full(len(flat), -HEIGHT_M / 2)])
        prisms.append(np.vstack([low, low + np.array([0.0, 0.0, HEIGHT_M])]))
    item = GraspObject("part", tuple(prisms), _MASS_KG)
    world = cell.world
    with ScratchFolder("push") as place:
        body = spawn_parts(
            world, item.write(place), _MASS_KG,
            friction=Friction(lateral=FRICTION / _FINGER_FRICTION, rolling=0.0),
            seen=(item.write_whole(place), (0.15, 0.25, 0.7, 1.0)),
        )  # fmt: skip
    at = (*part.com.tolist(), world.table_height + HEIGHT_M / 2 + 0.0005)
    world.put(body, at, (0.0, 0.0, 0.0, 1.0))
    world.step(0.3)
    return body


def _lens() -> Intrinsics:
    return Intrinsics.from_fov(640, 480, _FOV_RAD)


def image_of(cell: Workcell) -> NDArray[np.uint8]:
    """Return an image (480, 640, 3) uint8 of the table from straight above."""
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])  # x right, y down, z forward
    pose[:3, 3] = (*_PLACE, cell.world.table_height + _ABOVE_M)
    light = Lighting(direction=(0.0, 0.0, 1.0))  # from above: no shadow beside the part
    frame, _ = Camera(cell.world.client, _lens()).capture(pose, light)
    assert frame.rgb is not None
    return frame.rgb


def _metres(ring_px: Floats) -> Floats:
    """Return points (n, 2) of an image, y upwards, px, in the base frame at the part's top, m."""
    lens, depth = _lens(), _ABOVE_M - HEIGHT_M
    x = (ring_px[:, 0] - lens.cx) * depth / lens.fx
    y = (ring_px[:, 1] + lens.cy) * depth / lens.fy
    return np.column_stack([x, y]) + _PLACE


def to_pixels(points: Floats) -> Floats:
    """Return places of the image (n, 2), px, y downwards, of points (n, 2), m, base frame."""
    lens, depth = _lens(), _ABOVE_M - HEIGHT_M
    x, y = (np.asarray(points) - _PLACE).T
    return np.column_stack([lens.cx + x * lens.fx / depth, lens.cy - y * lens.fy / depth])


def plan_from_image(pixels: NDArray[np.uint8], jaw: float, stroke: float, seed: int) -> PushPlan:
    """Plan on the contour of an image with the thesis's settings: d_C 0, rho 10, five angles.

    Parameters
    ----------
    jaw, stroke
        Width of the jaws, and how far they open, m.
    """
    ring = as_polygon(_metres(rings_from_image(pixels)[0]))
    outline = without_details(Outline(ring, read=len(ring)))
    return plan_push_grasps(
        outline.polygon, jaw_width=jaw, friction=FRICTION, density=_DENSITY, samples=_SAMPLES,
        max_opening=stroke - _GAP_M - _ROOM_M, seed=seed,
    )  # fmt: skip


def chosen(plan: PushPlan, jaw: float, stroke: float) -> list[int]:
    """Return the best grasp, and those with the qualities nearest to the thesis's other two.

    Grasps whose hand would come down on the part are left out.
    """
    spans = [_span(plan, k, jaw) for k in range(len(plan.grasps))]
    room = stroke - _GAP_M - _ROOM_M
    fits = np.array([last - first <= room for _, first, last in spans])
    quality = np.where(fits, plan.analysis.quality, -np.inf)
    picks = [next(int(k) for k in plan.analysis.order if fits[k])]
    for published, _ in PUBLISHED[1:]:
        order = np.argsort(np.abs(quality - published / 100), kind="stable")
        picks.append(int(next(k for k in order if int(k) not in picks)))
    return picks


def first_contact(plan: PushPlan, index: int, jaw: float) -> float:
    """Return where the jaw first meets the part, m along the push from its nominal contact."""
    return _span(plan, index, jaw, 0.0)[1]


def _span(
    plan: PushPlan, index: int, jaw: float, room: float = _ROOM_M
) -> tuple[Floats, float, float]:
    """Return the middle (2,) of the jaw's face at the contact, and the part's begin and end, m.

    The latter along the push from that middle, within the jaw's width and some room beside it.
    """
    along = plan.grasps.approaches[index]
    beside = np.array([along[1], -along[0]])
    contact = plan.grasps.contacts[index]
    middle = contact + beside * (jaw / 2 if plan.grasps.left[index] else -jaw / 2)
    ring = plan.part.vertices
    share = np.linspace(0, 1, 200)[:, None, None]
    boundary = (ring + share * (np.roll(ring, -1, axis=0) - ring)).reshape(-1, 2) - middle
    inside = boundary[np.abs(boundary @ beside) < jaw / 2 + room] @ along
    return middle, float(inside.min()), float(inside.max())


def arm_push(
    plan: PushPlan, index: int, jaw: float, stroke: float, *, off: Floats, turned: float
) -> ArmPush:
    """Return how the arm carries out a grasp, misplaced by an error of its hand.

    Parameters
    ----------
    off : (2,), m
        Error of the hand's place, base frame.
    turned
        Error of its direction, rad.
    """
    along = plan.grasps.approaches[index]
    middle, first, _ = _span(plan, index, jaw)
    c, s = math.cos(turned), math.sin(turned)
    start = middle + (first - _GAP_M + stroke / 2) * along
    heading = np.array([[c, -s], [s, c]]) @ along
    return ArmPush(start + off, heading, _GAP_M - first + _TRAVEL_M, HEIGHT_M)


def printed(plan: PushPlan, jaw: float, number: int, seed: int) -> PlaneBody | None:
    """Return a perturbed part of the plan's own distribution; None = its outline crosses itself."""
    part = plan.part
    tolerance: Tolerance = plan.tolerance
    trials = Trials.of(part, plan.grasps, PushTest(jaw, FRICTION), tolerance, seed)
    vx, vy, mass, valid = trials.parts(_FIRST_PRINT + number, 1)
    if not valid[0]:
        return None
    ring = np.column_stack([vx[0], vy[0]]) * part.radius + part.centroid
    return PlaneBody(ring, mass[0] * part.radius + part.centroid)
