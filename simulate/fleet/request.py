"""``rtask simulate fetch``: a robot at a table fetches an object for a request in words."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import rtask
from features.perception import perceive
from rtask.client import Client
from rtask.scratch import ScratchFolder
from simulate.agent.agent import AgentConfig
from simulate.agent.fetcher import Fetcher, RequestServer
from simulate.agent.messages import pose_message
from simulate.agent.scoring import Scorer, watch_attempts
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.robots import describe
from simulate.world.camera import Lighting
from simulate.world.objects import sample_objects
from simulate.world.scene import arrange
from simulate.world.seeds import stream

__all__ = ["Request", "carry_out"]

_PRODUCTS, _TABLE, _LIGHT, _NOISE, _CHOICE = range(50, 55)
_LESSON, _TASK = 0, 1
WORDS = {"can": "can", "ball": "ball", "box": "box", "bottle": "bottle", "pen": "pen"}
"""Names that a person gives to the simulated products."""


@dataclass(frozen=True)
class Request:
    """A request and the table and server it refers to.

    Parameters
    ----------
    wanted
        The request in words, such as "something to drink from".
    url, token
        Server to use; without one, a graph in this process, in ``data`` or in memory.
    taught
        Whether a person has named each product to another robot once.
    """

    wanted: str
    seed: int = 0
    objects: int = 5
    robot: str = "nao"
    url: str = ""
    token: str | None = None
    data: Path | None = None
    taught: bool = True
    max_attempts: int = 4
    preset: str = "faithful"


def carry_out(request: Request) -> dict[str, Any]:
    """Let a robot carry out a request; return the outcome as JSON data.

    ``took`` names the true product that it chose last, if that lies in a box; the robot never
    learns it. What was in the way may lie there as well.
    """
    with ExitStack() as stack:
        assets = stack.enter_context(ScratchFolder("assets"))
        target: Any = request.url or stack.enter_context(rtask.open(request.data or ":memory:"))
        if request.taught:
            _teach(request, target, assets)
        body = _body(request, _TASK, assets)
        stack.callback(body.close)
        client = stack.enter_context(_connected(request, target, "fetcher"))
        client.call("register_robot", **body.robot.describe("fetcher"))
        choice = int(stream(request.seed, _CHOICE).integers(2**31))
        config = AgentConfig(max_attempts=request.max_attempts, seed=choice)
        watched = watch_attempts(body)
        fetcher = Fetcher(body, cast(RequestServer, client), config)
        fetched = fetcher.fetch(request.wanted)
        chosen = fetched.tried[-1]["object"] if fetched.tried else ""
        met = (
            encounter for encounter in fetcher.encounters.values() if encounter.object_iri == chosen
        )
        runs = [
            attempt.run for encounter in met for attempt in encounter.attempts if attempt.physical
        ]
        took = _in_a_box(body, watched[max(runs) - 1].target) if runs else ""
    return {**asdict(fetched), "took": took}


def _in_a_box(body: SimulatedBody, body_id: int) -> str:
    """Return the name of a product if it lies in a box, else nothing."""
    spec = body.world.objects.get(body_id)
    boxes = body.world.place_boxes.values()
    if spec is None or not any(_inside(body.world.object_pose(body_id), box) for box in boxes):
        return ""
    return spec.name


def _inside(pose: Any, box: Any) -> bool:
    return bool(
        box.x_range[0] < pose.x < box.x_range[1] and box.y_range[0] < pose.y < box.y_range[1]
    )


def _body(request: Request, table: int, assets: Path) -> SimulatedBody:
    products = sample_objects(stream(request.seed, _PRODUCTS), request.objects)
    workplace = describe(request.robot).workplace
    placements = arrange(products, stream(request.seed, _TABLE, table), workplace=workplace)
    conditions = Conditions(
        robot=request.robot,
        preset=request.preset,
        lighting=Lighting.sample(stream(request.seed, _LIGHT, table)),
        noise_seed=(request.seed, _NOISE, table),
    )
    return SimulatedBody(placements, assets, conditions)


def _connected(request: Request, target: Any, agent: str) -> Client:
    if request.url:
        return rtask.connect(request.url, token=request.token)
    return rtask.connect(target, agent=agent)


def _teach(request: Request, target: Any, assets: Path) -> None:
    """Let another robot see the products on another table while a person names their kinds."""
    from features.codec import encode_frame, to_wire

    body = _body(request, _LESSON, assets)
    try:
        scorer = Scorer(body)
        kinds = {laid.body: laid.placement.spec.kind for laid in body.laid}
        with _connected(request, target, "pupil") as client:
            client.call("register_robot", **body.robot.describe("pupil"))
            for side in ("right", "left"):
                frame, base_from_camera = body.look(side)
                view = perceive(frame, base_from_camera, body.ignored)
                for seen in view.objects:
                    kind = kinds.get(scorer.body_under(seen))
                    is_here = (seen.position[1] < 0) == (side == "right")
                    if kind is None or not is_here:
                        continue
                    client.insert_object(
                        objects=[
                            {
                                "data": to_wire(encode_frame(seen.crop)),
                                "sensor_pose": pose_message(base_from_camera),
                                "frame_id": body.base_frame,
                                "support_height": view.table_height,
                                "gripper_id": body.gripper_ids[side],
                                "class_description": WORDS[kind],
                            }
                        ]
                    )
    finally:
        body.close()
