"""``rtask grasp``: plan grasps of a part, a cloud, or an object of the graph."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rtask.cli.grasping.batch import batch
from rtask.cli.grasping.executors import executor_options, open_named
from rtask.cli.grasping.learning import train
from rtask.cli.grasping.push_report import plan_as_json, print_plan
from rtask.cli.options import (
    data_option,
    exit_if_empty,
    json_option,
    limit_option,
    print_json,
)
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from grasp.push import Outline, PushPlan


@click.group()
def grasp() -> None:
    """Plan grasps under uncertainty."""


grasp.add_command(train)
grasp.add_command(batch)


@grasp.command()
@click.argument("source")
@click.option(
    "--mode",
    type=click.Choice(["push", "space", "scene"]),
    help="Push grasps on a plane, grasps in space, or grasps of everything on a table (a cloud, z "
    "up).  [default: space for meshes, else push]",
)
@click.option(
    "--gripper",
    default="panda",
    show_default=True,
    help="Space: nao, panda, jaw:STROKE, suction:RADIUS or three:OPENING in m, or a file that "
    "describes one: JSON, TOML or URDF.",
)
@click.option(
    "--gripper-type",
    help="Name under which stored grasps are found again.  "
    "[default: parallel_jaw for push grasps, else that of the gripper]",
)
@click.option(
    "--part",
    "number",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Push: which part of a drawing or an image with several; 1 is the largest.",
)
@click.option("--max-opening", type=float, help="Push: stroke of the gripper.")
@click.option("--jaw-width", type=float, help="Push: width of the jaws.  [default: diameter / 4]")
@click.option(
    "--friction", type=float, help="Between jaw and object.  [default: 0.7 for push, 0.5 in space]"
)
@click.option("--mass", type=float, help="Space: mass of the object to hold, kg.")
@click.option("--scale", default=1.0, show_default=True, help="Space: m per unit of the file.")
@click.option("--floating", is_flag=True, help="Space: there is no table under the object.")
@click.option(
    "--viewpoint",
    type=(float, float, float),
    multiple=True,
    help="Space: position of the camera, m, once for each view in the cloud; the hidden side is "
    "then completed.",
)
@click.option(
    "--grasps",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Space: rank the grasps of this HDF5 file (ACRONYM's layout) of a mesh instead of own.",
)
@click.option(
    "--save-grasps",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Space: write the ranked grasps to this HDF5 file.",
)
@click.option(
    "--classifier",
    metavar="FILE",
    help="Space: a filter of grasps of clouds: a model made by `rtask grasp train`, or shipped for "
    "the one that comes with rtask for the hand.  [default: none]",
)
@click.option(
    "--vertex-std",
    type=float,
    help="Push: standard deviation of a vertex.  [default: 0.045 radii]",
)
@click.option(
    "--correlation",
    type=click.FloatRange(min=0, min_open=True),
    help="Push: length over which vertices deviate alike, in a smooth warp.  [default: each alone]",
)
@click.option(
    "--com-std",
    type=float,
    help="Push: standard deviation of the centre of mass.  [default: 0.084 radii]",
)
@click.option(
    "--position-std",
    type=float,
    help="Standard deviation of the position.  [default: 0 laterally for push, 0.004 m in space]",
)
@click.option(
    "--rotation-std-deg",
    type=float,
    help="Standard deviation of the rotation, degrees.  [default: 0 for push, 5.73 in space]",
)
@click.option("--samples", default=100, show_default=True, help="Perturbed shapes or poses.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Random seed of the perturbations.",
)
@click.option(
    "--density", default=1.5, show_default=True, help="Push: contacts on an edge of mean length."
)
@click.option(
    "--angles", default=5, show_default=True, help="Push: directions at a contact, an odd number."
)
@click.option(
    "--filter",
    "filter_distance",
    default=0.0,
    show_default=True,
    help="Push: simplify the outline by this distance, in radii, before choosing contacts.",
)
@click.option(
    "--eliminate",
    metavar="FIRST,SHARE",
    help="Push: drop this share of the candidates after the first so many samples.",
)
@click.option(
    "--race",
    is_flag=True,
    help="Push: drop grasps as soon as they are worse than the best beyond doubt; advised, with "
    "--samples 400.",
)
@click.option(
    "--method",
    type=click.Choice(["bound", "simulation"]),
    default="bound",
    show_default=True,
    help="Push: how a grasp is judged on one perturbed part.",
)
@click.option(
    "--closure",
    type=click.Choice(["strict", "nguyen"]),
    default="strict",
    show_default=True,
    help="Push: test of force closure.",
)
@click.option(
    "--sampling",
    type=click.Choice(["random", "sobol"]),
    default="random",
    show_default=True,
    help="Push: independent perturbations, or evenly spread ones.",
)
@click.option(
    "--deadline",
    "deadline_s",
    metavar="SECONDS",
    type=click.FloatRange(min=0, min_open=True),
    help="Push: rank by the perturbed parts that have been judged by then.  [default: all]",
)
@executor_options("the trials", "Push: ")
@limit_option(10, "Number of grasps to print, and to store.")
@click.option(
    "--min-confidence",
    default=0.3,
    show_default=True,
    help="Space: below this confidence, advise against grasping.",
)
@click.option(
    "--save-plots",
    "plots",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write drawings to (SVG).",
)
@click.option("--store", is_flag=True, help="Store the best grasps with the object in the graph.")
@data_option
@json_option
def plan(source: str, data: Path, as_json: bool, **options: Any) -> None:
    """Rank grasps of SOURCE, on a plane or in space. Exit code 1 if there are none.

    SOURCE is a part (.json, .svg, .dxf, or an image of it on a plain background), a mesh (.stl,
    .obj, .ply; z up), a segmented point cloud (.pcd, .ply, .npy, .xyz; z up), or the IRI, id or
    name of an object in the graph.

    Push grasps are ranked by a lower bound on their probability of force closure; their lengths are
    in the unit of the file, or in m for an object of the graph. Grasps in space are ranked by their
    confidence under an uncertain pose; their lengths are in m.
    """
    from rtask.cli.grasping.plan_in_space import is_mesh, plan_in_space
    from rtask.errors import RtaskError, UsageError

    if options["plots"]:
        _make_folder(options["plots"])
    options["top"] = options.pop("limit")
    if options["top"] < 1:
        raise UsageError(f"--limit {options['top']}: must be at least 1")
    if not 0 <= options["min_confidence"] <= 1:
        raise UsageError(f"--min-confidence {options['min_confidence']}: must be from 0 to 1")
    if options["workers"] < 0:
        raise UsageError(f"--workers {options['workers']}: must be 0 or more")
    mode = options.pop("mode") or ("space" if is_mesh(Path(source)) else "push")
    _refuse_others(source, mode)
    try:
        with announce_compilation():
            if mode != "push":
                options["scene"] = mode == "scene"
                plan_found = plan_in_space(source, data, as_json, options)
            else:
                plan_found = _plan(source, data, as_json, {**options, **_push_defaults(options)})
    except ValueError as error:
        if isinstance(error, RtaskError):
            raise
        raise UsageError(f"{source}: {error}") from error
    except BrokenPipeError:  # of the reader of what is printed
        raise
    except OSError as error:
        raise UsageError(f"{error.filename or source}: {error.strerror or error}") from error
    exit_if_empty(plan_found)


def _refuse_others(source: str, mode: str) -> None:
    """Refuse options that were given and have no effect in a mode, by what their help says."""
    from rtask.errors import UsageError

    context = click.get_current_context()
    others, here = ("Push:", "in space") if mode != "push" else ("Space:", "on a plane")
    for parameter in context.command.params:
        if context.get_parameter_source(parameter.name or "") is ParameterSource.DEFAULT:
            continue
        if isinstance(parameter, click.Option) and (parameter.help or "").startswith(others):
            raise UsageError(
                f"{parameter.opts[0]} has no effect here: grasps of {source} are planned {here} "
                "(--mode)"
            )


def _make_folder(folder: Path) -> None:
    """Create the folder for drawings before anything is planned."""
    from rtask.errors import UsageError

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--save-plots {folder}: {error.strerror}") from error


def _push_defaults(options: dict[str, Any]) -> dict[str, Any]:
    """Return the values of options that were not given, for push grasps."""
    values = {"friction": 0.7, "position_std": 0.0, "rotation_std_deg": 0.0,
              "gripper_type": "parallel_jaw"}  # fmt: skip
    return {name: value for name, value in values.items() if options[name] is None}


def _plan(source: str, data: Path, as_json: bool, options: dict[str, Any]) -> bool:
    """Plan push grasps; tell whether any of them closes."""
    import math

    from grasp.push import Elimination, Racing, as_part, plan_push_grasps
    from rtask.errors import UsageError

    outline, object_iri = _outline(source, data, options)
    part = as_part(outline.polygon, outline.com)
    jaw_width = options["jaw_width"]
    elimination: Elimination | Racing | None = None
    if options["eliminate"]:
        first, share = _first_and_share(options["eliminate"])
        elimination = Elimination((first, max(options["samples"] - first, 1)), share)
    if options["race"]:
        if elimination is not None:
            raise UsageError("--race and --eliminate exclude each other")
        elimination = Racing(options["samples"])
    position, rotation = options["position_std"], math.radians(options["rotation_std_deg"])
    with (
        Working("planning") as working,
        open_named(options) as executor,
    ):
        push_plan = plan_push_grasps(
            part.vertices,
            part.com,
            jaw_width=0.25 * part.diameter if jaw_width is None else jaw_width,
            pose_std=(position, rotation),
            elimination=elimination,
            executor=executor,
            progress=working.tell,
            **{key: options[key] for key in _PLANNED},
        )
    stored = (
        _store(data, object_iri, push_plan, outline.height, options) if options["store"] else None
    )
    drawings = _draw(push_plan, outline, options) if options["plots"] else []
    if as_json:
        print_json(plan_as_json(push_plan, outline, options["top"], stored, drawings))
        return bool(push_plan.quality > 0)
    print_plan(push_plan, outline.note, options["top"])
    if stored is not None:
        click.echo(f"stored {len(stored['grasps'])} grasps as {stored['commit']}")
    for drawing in drawings:
        click.echo(f"wrote {drawing}")
    return bool(push_plan.quality > 0)


_PLANNED = (
    "friction", "vertex_std", "com_std", "correlation", "filter_distance", "density", "angles",
    "samples", "method", "closure", "sampling", "max_opening", "seed", "deadline_s",
)  # fmt: skip


def _outline(source: str, data: Path, options: dict[str, Any]) -> tuple[Outline, str]:
    """Return the outline and, for an object of the graph, its IRI."""
    from grasp.push import Outline, outline_from_cloud, read_outline, without_details
    from rtask.errors import UsageError

    hidden = options["vertex_std"], options["correlation"] is not None
    path = Path(source)
    if path.is_file():
        if options["store"]:
            raise UsageError("--store needs an object of the graph, not a file")
        outline = read_outline(path, part=options["number"])
        # Vertices in JSON are what somebody wrote; those of a drawing stand for its curves.
        given = path.suffix.lower() == ".json"
        return (outline if given else without_details(outline, *hidden)), ""
    if not data.exists():
        if path.is_dir():
            raise UsageError(f"{source} is a folder; give a file in it")
        raise UsageError(f"{source}: no such file, and there is no knowledge base at {data}")
    from rtask.cli.connection import open_to_read
    from rtask.engine.engine import Engine
    from rtask.engine.records.shapes import object_cloud

    with open_to_read(data) as kb, Engine(kb) as engine:
        object_iri, points = object_cloud(engine.context, source)
    ring, height = outline_from_cloud(points)
    note = f"{object_iri}: footprint of {len(points)} points"
    outline = Outline(ring, None, len(ring), note, height, unit="m")
    return without_details(outline, *hidden), object_iri


def _first_and_share(text: str) -> tuple[int, float]:
    from rtask.errors import UsageError

    first, _, share = text.partition(",")
    try:
        return int(first), float(share)
    except ValueError as error:
        raise UsageError(f"--eliminate {text}: expected two numbers, such as 5,0.9") from error


def _store(
    data: Path, object_iri: str, push_plan: PushPlan, height: float, options: dict[str, Any]
) -> dict[str, Any]:
    import math

    import numpy as np

    import rtask
    from grasp.spatial.planar import tip_heights
    from rtask.engine.engine import Engine
    from rtask.engine.operations.planned import PlannedGrasp, store_planned
    from rtask.errors import UsageError

    sigma = float(np.mean(push_plan.tolerance.vertex_std))
    planned = []
    for i in push_plan.analysis.order[: options["top"]].tolist():
        if push_plan.analysis.successes[i] == 0:
            break
        along = push_plan.grasps.approaches[i]
        width = float(push_plan.openings[i])
        middle = push_plan.grasps.jaw(i, push_plan.test.jaw_width).mean(axis=0) + along * width / 2
        z = tip_heights(height, width, push_plan.part.diameter)[0]
        most = options["max_opening"] or math.inf
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
    with rtask.open(data) as kb, Engine(kb) as engine:
        return store_planned(engine.context, object_iri, planned, options["gripper_type"])


def _draw(push_plan: PushPlan, outline: Any, options: dict[str, Any]) -> list[str]:
    from grasp.push.figures.album import album

    folder: Path = options["plots"]
    names = []
    drawings = album(push_plan, outline.height, options["seed"], outline.unit, outline.holes)
    for name, drawing in drawings.items():
        path = folder / f"{name}.svg"
        path.write_text(drawing, "utf-8")
        names.append(str(path))
    return names
