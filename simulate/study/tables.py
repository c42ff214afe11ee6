"""Tables 4 and 5 of Gatto 2016 with the simulated robot: times of retrieval and grasping."""

from __future__ import annotations

import statistics
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import rtask
from features.codec import encode_frame, to_wire
from features.perception import Seen, perceive
from rtask.scratch import ScratchFolder
from simulate.agent.messages import pose_message
from simulate.agent.scoring import Scorer
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.demo.processes import Endpoint
from simulate.grasping.executor import GraspRequest, PlannedGrasp
from simulate.study.declaration import Report, Results, Study, Table
from simulate.world.camera import Lighting
from simulate.world.objects import Kind, ObjectSpec, product, sample_objects
from simulate.world.scene import arrange
from simulate.world.seeds import stream

__all__ = [
    "TABLE_4", "TABLE_5", "fill", "grasp_study", "looks_at", "retrieval_study",
    "retrieval_times", "table_4_times", "time_grasps", "time_retrievals",
]  # fmt: skip

TABLE_4: Mapping[str, float] = {
    "object 1": 5.531, "object 2": 4.995, "object 3": 4.350, "object 4": 6.014,
}  # fmt: skip
"""Round trip time for object retrieval, s (Gatto 2016, Table 4)."""

TABLE_5: Mapping[Kind, float] = {"pen": 10.501, "ball": 15.285, "bottle": 18.235, "can": 12.101}
"""Generation and execution of a grasp, s (Gatto 2016, Table 5); the can is its cylinder."""

_PRODUCTS, _TABLE, _LIGHT, _NOISE = range(60, 64)
_ON_TABLE = 4
_ATTEMPTS = 12
_PATIENCE_S = 300.0


def looks_at(
    specs: Sequence[ObjectSpec], seed: int, turn: int, assets: Path
) -> list[tuple[str, dict[str, Any], Seen]]:
    """Return a view of each visible product: its name, the request with the view, the crop.

    Parameters
    ----------
    specs
        Products placed on one table.
    turn
        Number of the arrangement, which determines places, light and noise.
    """
    conditions = Conditions(
        lighting=Lighting.sample(stream(seed, _LIGHT, turn)), noise_seed=(seed, _NOISE, turn)
    )
    body = SimulatedBody(arrange(specs, stream(seed, _TABLE, turn)), assets, conditions)
    looks = []
    try:
        scorer = Scorer(body)
        names = {laid.body: laid.placement.spec.name for laid in body.laid}
        for side in ("right", "left"):
            frame, base_from_camera = body.look(side)
            view = perceive(frame, base_from_camera, body.ignored)
            for seen in view.objects:
                name = names.get(scorer.body_under(seen), "")
                if name and (seen.position[1] < 0) == (side == "right"):
                    request = {
                        "data": to_wire(encode_frame(seen.crop)),
                        "sensor_pose": pose_message(base_from_camera),
                        "frame_id": body.base_frame,
                        "support_height": view.table_height,
                        "gripper_id": body.gripper_ids[side],
                    }
                    looks.append((name, request, seen))
    finally:
        body.close()
    return looks


def fill(client: rtask.client.Client, objects: int, seed: int) -> dict[str, list[ObjectSpec]]:
    """Store a view of each of ``n`` products; return their tables."""
    specs = sample_objects(stream(seed, _PRODUCTS), objects)
    tables = [specs[i : i + _ON_TABLE] for i in range(0, objects, _ON_TABLE)]
    tables_by_product: dict[str, list[ObjectSpec]] = {}
    with ScratchFolder("assets") as assets:
        for number, table in enumerate(tables):
            for name, request, _ in looks_at(table, seed, number, assets):
                client.insert_object(objects=[{**request, "name": name, "merge": False}])
                tables_by_product[name] = table
    return tables_by_product


def retrieval_times(
    client: rtask.client.Client, stored: Mapping[str, list[ObjectSpec]], seed: int, repeats: int
) -> list[dict[str, Any]]:
    """Retrieve four known products from new views; return the times of each, s.

    ``round_trip_s`` is the time that a robot waits, from the encoded view to the decoded answer:
    sending, recognition, the query, choosing a grasp, and the reply. ``server_s`` is the engine's
    share.
    """
    chosen = sorted(stored)[:: max(len(stored) // len(TABLE_4), 1)][: len(TABLE_4)]
    rows = []
    with ScratchFolder("assets") as assets:
        for label, name in zip(TABLE_4, chosen, strict=False):
            again = looks_at(stored[name], seed, 10_000, assets)
            request = next((r for seen, r, _ in again if seen == name), None)
            if request is None:
                continue
            trips: list[float] = []
            inside: list[float] = []
            answer: dict[str, Any] = {}
            for _ in range(repeats):
                started = time.perf_counter()
                answer = dict(client.recognise_for_grasp(propose=True, **request))
                trips.append(time.perf_counter() - started)
                inside.append(float(answer["times"]["total_s"]))
            rows.append(
                {
                    "object": label,
                    "product": name,
                    "recognised": answer["recognition"]["accepted"],
                    "bytes": len(request["data"]),
                    "round_trip_s": statistics.median(trips),
                    "server_s": statistics.median(inside),
                    "thesis_s": TABLE_4[label],
                }
            )
    return rows


def retrieval_study(objects: int, seed: int, repeats: int) -> Study:
    """Return the study of Table 4: one server is filled and asked, so that it is one trial."""
    settings = {"seed": seed, "objects": objects, "repeats": repeats}
    trial = "simulate.study.tables:time_retrievals"
    return Study("times of retrieval", trial, settings, 1, _describe)


def time_retrievals(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return the rows of Table 4."""
    return {"rows": table_4_times(settings["objects"], settings["seed"], settings["repeats"])}


def table_4_times(objects: int, seed: int, repeats: int) -> list[dict[str, Any]]:
    """Return the times of :func:`simulate.study.tables.retrieval_times` of a server of our own."""
    with ScratchFolder("table") as folder:
        endpoint = Endpoint(folder / "store", 0, folder / "log")
        try:
            # A busy machine makes its times longer, and must not end the study.
            with rtask.connect(endpoint.url, timeout_s=_PATIENCE_S) as client:
                hands = [
                    {"name": f"nao_{side}_hand", "gripper_type": "nao_hand", "max_opening": 0.05,
                     "max_payload": 0.3}
                    for side in ("right", "left")
                ]  # fmt: skip
                client.call(
                    "register_robot", name="nao", model="nao-h25-v5", simulated=True,
                    end_effectors=hands,
                )  # fmt: skip
                return retrieval_times(client, fill(client, objects, seed), seed, repeats)
        finally:
            endpoint.stop()


def grasp_study(repeats: int, seed: int, preset: str = "faithful") -> Study:
    """Return the study of Table 5; each trial is of one kind, planned from (X, Y, theta)."""
    settings = {"seed": seed, "repeats": repeats, "preset": preset}
    return Study(
        "times of grasps", "simulate.study.tables:time_grasps", settings, len(TABLE_5), _describe
    )


def time_grasps(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Plan and execute planar grasps of the kind of that number until enough have held.

    Returns
    -------
    One row with median times, s: ``plan_s`` is computing time; ``grasp_s`` the time of motion until
    the object has been lifted and held for two seconds; ``place_s`` the motion into the box and
    home. Only grasps that held are counted.
    """
    kind = tuple(TABLE_5)[number]
    done: list[dict[str, float]] = []
    for attempt in range(_ATTEMPTS * settings["repeats"]):
        if len(done) == settings["repeats"]:
            break
        times = _timed_grasp(kind, settings["seed"], attempt, settings["preset"])
        if times is not None:
            done.append(times)
    medians = {
        name: statistics.median(times[name] for times in done) if done else None
        for name in ("plan_s", "grasp_s", "place_s")
    }
    row = {"object": kind, "held": len(done), **medians, "thesis_s": TABLE_5[kind]}
    return {"rows": [row], "says": f"{kind}: {len(done)} held"}


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    """Report rows of times as they are."""
    rows = [row for result in results for row in result["rows"]]
    columns = list(rows[0]) if rows else []
    cells = [
        [f"{v:.3f}" if isinstance(v, float) else "-" if v is None else str(v) for v in row.values()]
        for row in rows
    ]
    return Report({"seed": settings["seed"], "rows": rows}, [Table("Times, s", columns, cells)])


def _timed_grasp(kind: Kind, seed: int, number: int, preset: str) -> dict[str, float] | None:
    """Return the times of one grasp; None if it could not be planned or did not hold."""
    rng = stream(seed, _TABLE, number)
    spec = product(kind, int(rng.integers(200)))
    (place,) = arrange([spec], rng, [(-1, 1)[number % 2]])
    along, across, height = spec.extent
    with ScratchFolder("assets") as assets:
        body = SimulatedBody([place], assets, Conditions(preset=preset))
        try:
            pose = body.world.object_pose(body.laid[0].body)
            request = GraspRequest(
                x=pose.x, y=pose.y, theta=pose.yaw + 1.5708, width=across, height=height,
                length=along, table_height=body.world.table_height, round=kind != "pen",
            )  # fmt: skip
            started = time.perf_counter()
            plan = body.executor.plan(request, seed=number)
            planned = time.perf_counter() - started
            if not isinstance(plan, PlannedGrasp):
                return None
            record = body.executor.execute(plan)
        finally:
            body.close()
    if not record.held:
        return None
    before = sum(
        record.times.get(p, 0.0) for p in ("pregrasp", "approach", "close", "lift", "hold")
    )
    return {"plan_s": planned, "grasp_s": before, "place_s": record.duration_s - before}
