"""Figures 3.20 to 3.23 of Kehoe 2014: uncertain pose by simulation, and Object M carried out."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from grasp.charts import heat_map
from grasp.push import PushTest, as_part
from grasp.push.parts import TAPE_DISPENSER, TAPE_DISPENSER_COM
from grasp.push.pose import centred_grasp, pose_map
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["object_m", "pose_uncertainty"]


def pose_uncertainty(setting: Setting) -> Result:
    """One grasp of a tape dispenser under uncertain pose: 10,000 quasi-static simulations."""
    part = as_part(TAPE_DISPENSER, TAPE_DISPENSER_COM)
    d = part.diameter
    position, rotation = np.linspace(0.055, 1.11, 10) * d, np.deg2rad(np.linspace(5, 60, 10))
    test = PushTest(0.35 * d)
    pose_map(part, centred_grasp(part, (0, 1), test.jaw_width), test, [0.1], [0.1], samples=2)
    margin: dict[str, Any] = {
        "tolerance": 0.1, "reason": "100 simulations a point: 1.96 x .05 at one half"
    }  # fmt: skip
    rows, pictures = [], {}
    for label, direction in (("across", (0, 1)), ("along", (1, 0))):
        grasp = centred_grasp(part, direction, test.jaw_width)
        began = time.process_time()
        quality = pose_map(part, grasp, test, position, rotation, seed=setting.seed).quality
        spent = time.process_time() - began
        what = f"stand-in pushed {label}"
        rows += [
            Compared(f"{what}: time of 10,000 simulations", spent, 317.0, "s", better="lower"),
            Compared(f"{what}: quality at the least uncertainty", float(quality[0, 0]), 0.452,
                     **margin),
            Compared(f"{what}: largest quality", float(quality.max()), 0.550, **margin),
            Compared(f"{what}: least quality", float(quality.min()), 0.033, **margin),
        ]  # fmt: skip
        pictures[f"pushed {label}: quality over uncertain rotation and position"] = heat_map(
            quality, np.rad2deg(rotation).round().tolist(), (position / d).round(2).tolist(),
            f"Fig. 3.23, stand-in pushed {label}", ("rotation, deg", "position / D"),
        )  # fmt: skip
    return Result(
        tuple(rows),
        (
            "a tape dispenser of our own drawing: the thesis's outline is not published, and which "
            "of its sides is pushed is not said",
            "theirs: Box2D by a Python binding; ours: compiled, processor seconds of one core",
        ),
        pictures,
    )


def object_m(setting: Setting) -> Result:
    """Three grasps of Object M, planned by quality and carried out by a Panda."""
    from simulate.study.pushes.picture import draw_pushes
    from simulate.study.pushes.report import push_study, summarise_pushes
    from simulate.study.runner import run

    trials = setting.size(5, 1)
    with tempfile.TemporaryDirectory(prefix="rtask-object-m-") as folder:
        results = run(push_study(trials, 0, setting.seed, "fast"), Path(folder), 1)
        summary = summarise_pushes(results, setting.seed, "fast")
        picture = Path(folder) / "grasps.png"
        draw_pushes(picture, setting.seed, "fast")
        drawn = picture.read_bytes()
    rows = []
    for number, (grasp, theirs) in enumerate(zip(summary["grasps"], (5, 5, 0), strict=True), 1):
        held = grasp["plug"]["held"]
        rows.append(share_of(f"grasp {number} of a plug drawn by us: held", held["hits"], held["n"],
                             theirs / 5, better="higher"))  # fmt: skip
    return Result(
        tuple(rows),
        (
            "a plug of our own drawing: Object M is not published; a Panda instead of a Zymark",
            "the thesis's third grasp failed in all trials; friction at the pads of a closed hand "
            "may hold ours where it is not flat between them",
            *setting.shrunk("trials of each grasp", 5, trials),
        ),
        {"the three grasps": drawn},
    )
