"""The act module of Gatto 2016: Tables 1, 4 and 5, Figures 4, 25, 26, 29 and 30."""

from __future__ import annotations

from rtask.scratch import ScratchFolder
from simulate.act.service import ActService
from simulate.act.trials import place_test, reach_test, reasons
from simulate.act.workspace import map_workspace
from simulate.grasping.executor import Workcell
from simulate.motion.arm_space import ArmSpace
from simulate.robots import describe
from simulate.robots import facts_nao as facts
from simulate.study.tables import TABLE_4, grasp_study, retrieval_study
from simulate.thesis.materials.pictures import png
from simulate.thesis.result import Compared, Result, Setting, counted, share_of
from simulate.world.portrait import portrait

__all__ = ["arm", "portrait_of_nao", "table_1", "table_4", "table_5", "test_program", "workspace"]

_NOT_MESHES = "boxes and cylinders of our own: the maker's meshes may not be passed on"


def table_1(setting: Setting) -> Result:
    """The Nao's hardware, of what a simulated body has."""
    nao = describe("nao")
    hands = len(nao.arms)
    joints = len(facts.HEAD_JOINTS) + 2 * (len(facts.ARM_JOINTS) + len(facts.LEG_JOINTS)) + hands
    with Workcell("nao", preset="fast") as cell:
        client, body = cell.world.client, cell.robot.body
        spans = [client.getAABB(body, link) for link in range(-1, client.getNumJoints(body))]
    height = max(high[2] for _, high in spans) - min(low[2] for low, _ in spans)
    return Result(
        (
            Compared("height, ours with the camera on its head", 100 * height, 58.0, "cm"),
            Compared("mass", facts.TOTAL_MASS, 4.3, "kg"),
            counted("degrees of freedom", float(joints - 1), 25.0),
        ),
        (
            "ours after the maker's documentation of the NAO H25 V5, whose link masses sum to "
            f"{facts.TOTAL_MASS:.2f} kg; both legs share one joint, and are locked while it stands",
            "power, processor, sensors and connections of the real robot are not simulated",
        ),
    )  # fmt: skip


def portrait_of_nao(setting: Setting) -> Result:
    """The Nao with an RGB-D camera at its table, in the simulator."""
    return _shown("nao", (960, 640))


def arm(setting: Setting) -> Result:
    """The joints of the Nao's right arm."""
    right = describe("nao").arm("right")
    drawn = _shown("nao", (960, 640))
    return Result(
        (counted("joints of an arm without its hand", float(len(right.joints)), 4.0),),
        (
            "the text of 4.1 counts four; the maker lists five with the wrist, which ours has",
            *drawn.notes,
        ),
        drawn.pictures,
    )


def _shown(robot: str, size: tuple[int, int]) -> Result:
    with Workcell(robot, preset="fast") as cell:
        picture = portrait(cell.world, cell.executor.eyes.camera, size)
    return Result((), (_NOT_MESHES,), {f"the simulated {robot}": png(picture)})


def test_program(setting: Setting) -> Result:
    """Goals drawn at random, reached and placed at by the Nao (Fig. 29)."""
    trials = setting.size(100, 6)
    rows = []
    notes = []
    for what, run in (("reach", reach_test), ("place", place_test)):
        with Workcell("nao", preset="fast") as cell:
            outcomes = run(ActService(cell, seed=setting.seed), trials, setting.seed)
        reached = sum(trial.reached for trial in outcomes)
        rows.append(share_of(f"random goals to {what}", reached, trials))
        missed = {k: v for k, v in reasons(outcomes).items() if k != "ok"}
        notes += [f"{what}: not reached because of {name}: {n}" for name, n in missed.items()]
    return Result(
        tuple(rows),
        (
            "the thesis shows one attempt and gives no rate",
            *setting.shrunk("goals", 100, trials),
            *notes,
        ),
    )


def workspace(setting: Setting) -> Result:
    """Where the hand reaches over the table, and in how many directions it closes (Fig. 30)."""
    heights = (0.32,) if setting.fast else (0.30, 0.32, 0.35)
    step = 0.04 if setting.fast else 0.02
    reach = map_workspace(
        ArmSpace(describe("nao")), step=step, heights=heights, angles=6, seed=setting.seed
    )
    with ScratchFolder("reach") as folder:
        path = folder / "reach.png"
        reach.write_png(path)
        drawn = path.read_bytes()
    return Result(
        tuple(
            Compared(f"area with half of the closing directions, tool at {h:g} m", 1e4 * area,
                     unit="cm2")
            for h, area in reach.area_m2().items()
        ),
        (
            "the thesis shows the hand's interactive marker and gives no figures",
            *((f"a cell of {step} m and one height (--fast)",) if setting.fast else ()),
        ),
        {"reach over the table": drawn},
    )  # fmt: skip


def table_4(setting: Setting) -> Result:
    """Round trip from a view to the answer of the graph, over the websocket."""
    stored = setting.size(111, 12)
    study = retrieval_study(stored, setting.seed, setting.size(10, 3))
    timed = {row["object"]: row for row in setting.trials(study)[0]["rows"]}
    trips = (
        Compared(
            f"{name} ({timed[name]['product']})" if name in timed else f"{name}: was not in view",
            timed[name]["round_trip_s"] if name in timed else None,
            theirs, "s", better="lower",
        )
        for name, theirs in TABLE_4.items()
    )  # fmt: skip
    recognised = sum(row["recognised"] for row in timed.values())
    return Result(
        (*trips, share_of("views that were recognised", recognised, len(timed))),
        (
            "simulated products; robot and server on one machine, so that no network is in it",
            "times by the clock, as the thesis's",
            *setting.shrunk("products in the graph", 111, stored),
        ),
    )


def table_5(setting: Setting) -> Result:
    """Planning and carrying out a grasp from (X, Y, theta)."""
    repeats = setting.size(3, 1)
    rows = []
    held = 0
    preset = "fast" if setting.fast else "faithful"
    study = grasp_study(repeats, setting.seed, preset)
    for row in (row for result in setting.trials(study) for row in result["rows"]):
        held += row["held"]
        ours = None if row["plan_s"] is None else row["plan_s"] + row["grasp_s"]
        what = f"{row['object']}: planning by the clock and motion in simulated time"
        rows.append(Compared(what, ours, row["thesis_s"], "s", better="lower"))
    return Result(
        tuple(rows),
        (
            f"{held} of {repeats * len(rows)} grasps held; the time ends two seconds after the "
            "lift, so that it includes seeing that it holds",
            "the thesis's trials ran on the simulated and on the real Nao; the can is its cylinder",
            *setting.shrunk("grasps of each kind", 3, repeats),
            *(("coarse physics (--fast)",) if setting.fast else ()),
        ),
    )
