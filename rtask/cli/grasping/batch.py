"""``rtask grasp batch``: grasps in space of many meshes, each planned wherever there is room."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.grasping.executors import executor_options, open_named
from rtask.cli.grasping.spatial import pose_noise, pose_options
from rtask.cli.options import (
    announce_more,
    announce_why_computed,
    json_option,
    limit_option,
    print_json,
)
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import RtaskError, UsageError

if TYPE_CHECKING:
    from grasp.batch import BatchPlan, Planned

__all__ = ["batch"]


@click.command()
@click.argument(
    "meshes", nargs=-1, required=True, type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option(
    "--gripper",
    default="panda",
    show_default=True,
    help="nao, panda, jaw:STROKE, suction:RADIUS or three:OPENING in m, or a file that describes "
    "one: JSON, TOML or URDF.",
)
@click.option("--mass", type=float, help="Mass of each object, kg.  [default: not known]")
@click.option("--scale", default=1.0, show_default=True, help="m per unit of the files.")
@click.option("--floating", is_flag=True, help="There is no table under the objects.")
@pose_options
@executor_options("the plans")
@click.option(
    "--deadline",
    type=click.FloatRange(min=0, min_open=True),
    help="Seconds after which the next result is the last that is waited for.  [default: all are]",
)
@limit_option(10, "Number of grasps of each object to return.")
@click.option(
    "--save-grasps",
    type=click.Path(path_type=Path, file_okay=False),
    help="Write the grasps of each object to a file <name>.h5 in this folder as soon as they are "
    "planned.",
)
@json_option
def batch(meshes: tuple[Path, ...], as_json: bool, **options: Any) -> None:
    """Plan grasps in space of many MESHES (.stl, .obj, .ply; z up).

    Each object is planned by itself, and its line is printed as soon as it is done; results are the
    same wherever they run. Exit code 1 if an object was not planned or has no grasp.
    """
    try:
        task = _task(meshes, options)
        files = _files(meshes, options["save_grasps"])
        with announce_compilation():
            planned, seconds = _planned(task, options, files, as_json)
    except ValueError as error:
        if isinstance(error, RtaskError):
            raise
        raise UsageError(str(error)) from error
    except OSError as error:
        if error.filename is None:  # of no file: a reader that went away, for example
            raise
        raise UsageError(f"{error.filename}: {error.strerror}") from error
    if as_json:
        print_json(_as_json(task, planned, seconds, options))
    else:
        for mesh in task.meshes:
            if mesh.name not in planned:
                click.echo(f"{mesh.name}: not planned by the deadline")
        click.echo(f"{len(planned)} of {len(task.meshes)} objects in {seconds:.1f} s")
    if len(planned) < len(task.meshes) or not all(plan.proposals for plan in planned.values()):
        raise click.exceptions.Exit(1)


def _task(meshes: tuple[Path, ...], options: dict[str, Any]) -> BatchPlan:
    from grasp.batch import BatchPlan, MeshFile
    from grasp.spatial.grasp_plan import SpatialOptions
    from grasp.spatial.gripper_files import end_effector_named

    if len(set(meshes)) < len(meshes):
        raise UsageError("a mesh is named twice")
    spatial = SpatialOptions(
        noise=pose_noise(options["position_std"], options["rotation_std_deg"]),
        samples=options["samples"], mass=options["mass"],
        seed=options["seed"], most=max(options["limit"], 50),
    )  # fmt: skip
    return BatchPlan(
        tuple(MeshFile.read(mesh) for mesh in meshes), end_effector_named(options["gripper"]),
        spatial, options["scale"], options["floating"],
    )  # fmt: skip


def _files(meshes: tuple[Path, ...], folder: Path | None) -> dict[str, Path]:
    """Return where the grasps of each mesh are written; two meshes never share a file."""
    if folder is None:
        return {}
    files = {str(mesh): folder / f"{mesh.stem}.h5" for mesh in meshes}
    if len(set(files.values())) < len(files):
        raise UsageError("--save-grasps: two meshes have the same name, so their files would too")
    folder.mkdir(parents=True, exist_ok=True)
    return files


def _planned(
    task: BatchPlan, options: dict[str, Any], files: dict[str, Path], is_quiet: bool
) -> tuple[dict[str, Planned], float]:
    """Return what was planned by the deadline, by name, and how many seconds it took."""
    from grasp.spatial.interchange import write_grasps

    began = time.monotonic()
    planned: dict[str, Planned] = {}
    ranges = [(i, 1) for i in range(len(task.meshes))]
    where = options["executor"], options["server"], options["cluster"], options["workers"]
    with open_named(*where) as executor, Working("planning") as working:
        for _, (plan,) in executor.finished(task, ranges):
            planned[plan.name] = plan
            if plan.name in files and plan.proposals:
                candidates = plan.proposals.candidates[: options["limit"]]
                write_grasps(files[plan.name], candidates, task.gripper, plan.name, task.scale)
            working.tell(len(planned), len(ranges))
            if not is_quiet:
                with working.aside():
                    click.echo(_line(plan))
            if options["deadline"] and time.monotonic() - began >= options["deadline"]:
                break
    if planned and not is_quiet:
        announce_why_computed(
            "computed from the shapes alone, no robot tried these grasps; `rtask grasp space MESH` "
            "with the same options shows each of them"
        )
    return planned, time.monotonic() - began


def _line(plan: Planned) -> str:
    if not plan.proposals:
        return f"{plan.name}: no grasp: {plan.error or plan.proposals.reason}"
    best = max(candidate.scores["confidence"] for candidate in plan.proposals)
    return f"{plan.name}: {len(plan.proposals)} grasps, the best with confidence {best:.2f}"


def _as_json(
    task: BatchPlan, planned: dict[str, Planned], seconds: float, options: dict[str, Any]
) -> dict[str, Any]:
    from grasp.messages import spatial_grasp_message

    objects = []
    not_shown = 0
    for mesh in task.meshes:
        plan = planned.get(mesh.name)
        if plan is None:
            objects.append({"mesh": mesh.name, "planned": False, "grasps": [], "reason": ""})
            continue
        grasps = [
            {
                **{name: float(value) for name, value in candidate.scores.items()},
                "width": float(candidate.width),
                "message": spatial_grasp_message(candidate, task.gripper, "object"),
            }
            for candidate in plan.proposals.candidates[: options["limit"]]
        ]
        not_shown += max(0, len(plan.proposals) - options["limit"])
        reason = plan.error or plan.proposals.reason
        objects.append({"mesh": mesh.name, "planned": True, "grasps": grasps, "reason": reason})
    announce_more(not_shown, what="grasps")
    return {"gripper": task.gripper.name, "seconds": seconds, "objects": objects}
