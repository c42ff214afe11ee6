"""``rtask grasp push``: push grasps of a part, a cloud, or an object of the graph, on a plane."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from rtask.cli.grasping.executors import ExecutorName, executor_options, open_named
from rtask.cli.grasping.planning import announce_stored, errors_name, make_plot_folder, seed_option
from rtask.cli.grasping.push_report import plan_as_json, print_plan
from rtask.cli.options import data_option, exit_if_empty, json_option, limit_option, print_json
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import UsageError

if TYPE_CHECKING:
    from grasp.push import Elimination, Outline, PushPlan, Racing
    from grasp.push.shards import Executor

__all__ = ["push"]


@dataclass(frozen=True, kw_only=True)
class _PushCall:
    """Options of ``rtask grasp push``; see its help. Lengths are in the unit of the file."""

    part: int
    gripper_type: str
    max_opening: float | None
    jaw_width: float | None
    friction: float
    vertex_std: float | None
    correlation: float | None
    com_std: float | None
    position_std: float
    rotation_std_deg: float
    samples: int
    seed: int
    density: float
    angles: int
    filter_distance: float
    eliminate: str | None
    race: bool
    method: Literal["bound", "simulation"]
    closure: Literal["strict", "nguyen"]
    sampling: Literal["random", "sobol"]
    deadline_s: float | None
    limit: int
    save_plots: Path | None
    store: bool

    def __post_init__(self) -> None:
        if self.race and self.eliminate:
            raise UsageError("--race and --eliminate exclude each other")
        if self.save_plots is not None:
            make_plot_folder(self.save_plots)

    def elimination(self) -> Elimination | Racing | None:
        """Return when candidates are dropped."""
        from grasp.push import Elimination, Racing

        if self.race:
            return Racing(self.samples)
        if not self.eliminate:
            return None
        first, share = _first_and_share(self.eliminate)
        return Elimination((first, max(self.samples - first, 1)), share)


@click.command()
@click.argument("source")
@click.option(
    "--gripper-type",
    default="parallel_jaw",
    show_default=True,
    help="Name under which stored grasps are found again.",
)
@click.option(
    "--part",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Which part of a drawing or an image with several; 1 is the largest.",
)
@click.option("--max-opening", type=float, help="Stroke of the gripper.  [default: any]")
@click.option("--jaw-width", type=float, help="Width of the jaws.  [default: diameter / 4]")
@click.option("--friction", default=0.7, show_default=True, help="Between jaw and object.")
@click.option(
    "--vertex-std", type=float, help="Standard deviation of a vertex.  [default: 0.045 radii]"
)
@click.option(
    "--correlation",
    type=click.FloatRange(min=0, min_open=True),
    help="Length over which vertices deviate alike, in a smooth warp.  [default: each alone]",
)
@click.option(
    "--com-std",
    type=float,
    help="Standard deviation of the centre of mass.  [default: 0.084 radii]",
)
@click.option(
    "--position-std",
    default=0.0,
    show_default=True,
    help="Standard deviation of the position, laterally.",
)
@click.option(
    "--rotation-std-deg",
    default=0.0,
    show_default=True,
    help="Standard deviation of the rotation, degrees.",
)
@click.option("--samples", default=100, show_default=True, help="Perturbed parts.")
@seed_option
@click.option(
    "--density", default=1.5, show_default=True, help="Contacts on an edge of mean length."
)
@click.option(
    "--angles", default=5, show_default=True, help="Directions at a contact, an odd number."
)
@click.option(
    "--filter",
    "filter_distance",
    default=0.0,
    show_default=True,
    help="Simplify the outline by this distance, in radii, before choosing contacts.",
)
@click.option(
    "--eliminate",
    metavar="FIRST,SHARE",
    help="Drop this share of the candidates after the first so many samples.",
)
@click.option(
    "--race",
    is_flag=True,
    help="Drop grasps as soon as they are worse than the best beyond doubt; advised, with "
    "--samples 400.",
)
@click.option(
    "--method",
    type=click.Choice(["bound", "simulation"]),
    default="bound",
    show_default=True,
    help="How a grasp is judged on one perturbed part.",
)
@click.option(
    "--closure",
    type=click.Choice(["strict", "nguyen"]),
    default="strict",
    show_default=True,
    help="Test of force closure.",
)
@click.option(
    "--sampling",
    type=click.Choice(["random", "sobol"]),
    default="random",
    show_default=True,
    help="Independent perturbations, or evenly spread ones.",
)
@click.option(
    "--deadline",
    "deadline_s",
    metavar="SECONDS",
    type=click.FloatRange(min=0, min_open=True),
    help="Rank by the perturbed parts that have been judged by then.  [default: all]",
)
@executor_options("the trials")
@limit_option(10, "Number of grasps to print, and to store.")
@click.option(
    "--save-plots",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write drawings to (SVG).",
)
@click.option("--store", is_flag=True, help="Store the best grasps with the object in the graph.")
@data_option
@json_option
def push(
    source: str, data: Path, as_json: bool, executor: ExecutorName, server: str | None,
    cluster: str | None, workers: int, **options: Any,
) -> None:  # fmt: skip
    """Rank push grasps of SOURCE on a plane. Exit code 1 if there are none.

    SOURCE is a part (.json, .svg, .dxf, or an image of it on a plain background), a segmented point
    cloud (.pcd, .ply, .npy, .xyz; z up), or the IRI, id or name of an object in the graph.

    Grasps are ranked by a lower bound on their probability of force closure; lengths are in the
    unit of the file, or in m for an object of the graph.
    """
    with errors_name(source), announce_compilation():
        call = _PushCall(**options)
        outline, object_iri = _outline(source, data, call)
        with open_named(executor, server, cluster, workers) as opened:
            push_plan = _planned(outline, opened, call)
        stored = _store(data, object_iri, push_plan, outline.height, call) if call.store else None
        drawings = _draw(push_plan, outline, call)
        if as_json:
            print_json(plan_as_json(push_plan, outline, call.limit, stored, drawings))
        else:
            print_plan(push_plan, outline.note, call.limit)
            if stored is not None:
                announce_stored(stored)
            for drawing in drawings:
                click.echo(f"wrote {drawing}")
    exit_if_empty(push_plan.quality > 0)


def _planned(outline: Outline, executor: Executor, call: _PushCall) -> PushPlan:
    import math

    from grasp.push import as_part, plan_push_grasps

    part = as_part(outline.polygon, outline.com)
    with Working("planning") as working:
        return plan_push_grasps(
            part.vertices,
            part.com,
            jaw_width=0.25 * part.diameter if call.jaw_width is None else call.jaw_width,
            max_opening=call.max_opening,
            friction=call.friction,
            vertex_std=call.vertex_std,
            com_std=call.com_std,
            correlation=call.correlation,
            pose_std=(call.position_std, math.radians(call.rotation_std_deg)),
            filter_distance=call.filter_distance,
            density=call.density,
            angles=call.angles,
            samples=call.samples,
            seed=call.seed,
            sampling=call.sampling,
            method=call.method,
            closure=call.closure,
            elimination=call.elimination(),
            deadline_s=call.deadline_s,
            executor=executor,
            progress=working.tell,
        )


def _outline(source: str, data: Path, call: _PushCall) -> tuple[Outline, str]:
    """Return the outline and, for an object of the graph, its IRI."""
    from grasp.push import Outline, outline_from_cloud, read_outline, without_details
    from grasp.spatial.meshes.mesh_files import is_mesh

    hidden = call.vertex_std, call.correlation is not None
    path = Path(source)
    if path.is_file():
        if call.store:
            raise UsageError("--store needs an object of the graph, not a file")
        if is_mesh(path):
            raise UsageError(f"{source} is a mesh: `rtask grasp space` plans grasps of it")
        outline = read_outline(path, part=call.part)
        # Vertices in JSON are what somebody wrote; those of a drawing stand for its curves.
        given = path.suffix.lower() == ".json"
        return (outline if given else without_details(outline, *hidden)), ""
    if not data.exists():
        if path.is_dir():
            raise UsageError(f"{source} is a folder; give a file in it")
        raise UsageError(f"{source}: no such file, and there is no knowledge base at {data}")
    from rtask.cli.connection import open_to_read
    from rtask.cli.things import name_or_iri
    from rtask.engine.engine import Engine
    from rtask.engine.records.shapes import object_cloud

    with open_to_read(data) as kb, Engine(kb) as engine:
        object_iri, points = object_cloud(engine.context, name_or_iri(source, data))
    ring, height = outline_from_cloud(points)
    note = f"{object_iri}: footprint of {len(points)} points"
    outline = Outline(ring, None, len(ring), note, height, unit="m")
    return without_details(outline, *hidden), object_iri


def _first_and_share(text: str) -> tuple[int, float]:

    first, _, share = text.partition(",")
    try:
        return int(first), float(share)
    except ValueError as error:
        raise UsageError(f"--eliminate {text}: expected two numbers, such as 5,0.9") from error


def _store(
    data: Path, object_iri: str, push_plan: PushPlan, height: float, call: _PushCall
) -> dict[str, Any]:
    import math

    import numpy as np

    from grasp.spatial.planar import tip_heights
    from rtask.cli.connection import open_to_change
    from rtask.engine.engine import Engine
    from rtask.engine.operations.planned import PlannedGrasp, store_planned

    sigma = float(np.mean(push_plan.tolerance.vertex_std))
    planned = []
    for i in push_plan.analysis.order[: call.limit].tolist():
        if push_plan.analysis.successes[i] == 0:
            break
        along = push_plan.grasps.approaches[i]
        width = float(push_plan.openings[i])
        middle = push_plan.grasps.jaw(i, push_plan.test.jaw_width).mean(axis=0) + along * width / 2
        z = tip_heights(height, width, push_plan.part.diameter)[0]
        most = call.max_opening or math.inf
        planned.append(
            PlannedGrasp(
                float(middle[0]), float(middle[1]), z, math.atan2(along[1], along[0]), width,
                min(1.2 * width + 2 * sigma, most), float(push_plan.analysis.quality[i]),
                int(push_plan.analysis.tried[i]), sigma,
            )
        )  # fmt: skip
    if not planned:
        raise UsageError(
            "nothing stored: no candidate closes; try more candidates (--density, --angles)"
        )
    with open_to_change(data) as kb, Engine(kb) as engine:
        return store_planned(engine.context, object_iri, planned, call.gripper_type)


def _draw(push_plan: PushPlan, outline: Outline, call: _PushCall) -> list[str]:
    from grasp.push.figures.album import album

    folder = call.save_plots
    if folder is None:
        return []
    names = []
    drawings = album(push_plan, outline.height, call.seed, outline.unit, outline.holes)
    for name, drawing in drawings.items():
        path = folder / f"{name}.svg"
        path.write_text(drawing, "utf-8")
        names.append(str(path))
    return names
