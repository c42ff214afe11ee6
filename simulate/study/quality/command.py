"""The command ``rtask study grasp-quality``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from simulate import options
from simulate.study.command import study_command

if TYPE_CHECKING:
    from simulate.study.declaration import Study

__all__ = ["grasp_quality"]


@study_command("rtask-grasp-quality", "grasp-quality", with_preset=False)
@click.option("--objects", default=90, show_default=True, help="Of each hand, families in turn.")
@click.option("-n", "--trials", default=4, show_default=True, type=click.IntRange(min=1),
              help="Draws for each object.")  # fmt: skip
@options.seed("every object and draw")
@click.option(
    "--ycb",
    default=None,
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of YCB models; every second one takes part.",
)
@click.option(
    "--ranked",
    default=6,
    show_default=True,
    type=click.IntRange(min=0),
    help="Grasps of each plan, from the best to the worst, for rank correlations; 0 = none.",
)
@click.option("--alone", is_flag=True,
    help="Carry out the planned grasps only: promises and coverage, without a comparison.",
)  # fmt: skip
@click.option(
    "--made",
    default=0,
    show_default=True,
    type=click.IntRange(0, 1000),
    help="Generated hands instead of the Panda's and the NAO's: fits what the factory promises.",
)
@click.option(
    "--public",
    default=None,
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of public models alone: NAME/NAME.urdf, as in pybullet's random_urdfs.",
)
@click.option("--fit", is_flag=True,
    help="Fit what the factory promises of these two hands, from the generated objects.",
)  # fmt: skip
@click.option("--varied", is_flag=True,
    help="Objects of a wider family: not convex, thin-walled, with handles, small, long, light.",
)  # fmt: skip
def grasp_quality(
    objects: int, trials: int, seed: int, ycb: Path | None, ranked: int, alone: bool, made: int,
    varied: bool, public: Path | None, fit: bool,
) -> Study:  # fmt: skip
    """Compare planned grasps with a trivial sampler's: lifted and shaken under pose errors.

    A hand without an arm, the Panda's at 20 N and the NAO's at 2 N, carries out the first grasp of
    a plan, the first by s_G alone and the sampler's, all under the same draws of pose error,
    friction and centre of mass. Differences are paired by object. Further grasps of each plan tell
    how well its scores rank them.
    """
    from simulate.study.quality.report import quality_study

    models = str(ycb.resolve()) if ycb else ""
    return quality_study(
        objects, trials, seed, models, ranked=ranked, alone=alone, made=made, varied=varied,
        public=str(public.resolve()) if public else "", fit=fit,
    )  # fmt: skip
