"""Options that the commands share which plan grasps in space."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rtask.cli.grasping.planning import make_plot_folder, seed_option
from rtask.errors import UsageError

if TYPE_CHECKING:
    from grasp.spatial.gripper import EndEffector
    from grasp.spatial.scoring.confidence import PoseNoise

__all__ = [
    "SpatialCall",
    "pose_noise",
    "pose_options",
    "result_options",
]

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, kw_only=True)
class SpatialCall:
    """Options of a command that plans grasps in space.

    Parameters
    ----------
    gripper
        Name or file of an end effector.
    friction
        Between jaw and object; None for that of the gripper.
    mass
        Of an object to hold, kg.
    scale
        Metres per unit of the file.
    position_std, rotation_std_deg
        Deviations of the pose, m and degrees; None for the usual ones.
    samples
        Perturbed poses of each grasp.
    limit
        Grasps to print and to store.
    min_confidence
        Below it, the advice is not to grasp.
    save_plots
        Folder of drawings.
    save_grasps
        HDF5 file of the ranked grasps.
    """

    gripper: str
    friction: float | None
    mass: float | None
    scale: float
    position_std: float | None
    rotation_std_deg: float | None
    samples: int
    seed: int
    limit: int
    min_confidence: float
    save_plots: Path | None
    save_grasps: Path | None

    def __post_init__(self) -> None:
        """Refuse before planning what would only show after it."""
        if not 0 <= self.min_confidence <= 1:  # NaN passes click's ranges
            raise UsageError(f"--min-confidence {self.min_confidence}: must be from 0 to 1")
        if self.save_plots is not None:
            make_plot_folder(self.save_plots)
        target = self.save_grasps
        if target is not None and not target.absolute().parent.is_dir():
            raise UsageError(f"--save-grasps {target}: there is no folder {target.parent}")

    @property
    def noise(self) -> PoseNoise:
        """Deviations of the pose."""
        return pose_noise(self.position_std, self.rotation_std_deg)

    @property
    def most(self) -> int:
        """Grasps to rank: never so few that the order of the first depends on it."""
        return max(self.limit, 50)

    def end_effector(self) -> EndEffector:
        """Return the gripper, with the friction of the call."""
        from dataclasses import replace

        from grasp.spatial.gripper_files import end_effector_named

        named = end_effector_named(self.gripper)
        return named if self.friction is None else replace(named, friction=self.friction)

    def refuse_for_contacts(self, hand: EndEffector, *names: str) -> None:
        """Refuse options that have an effect on two jaws only."""
        what = "a suction cup" if hand.contact_kind == "suction" else "three fingers"
        for name in names:
            if getattr(self, name):
                option = name.replace("_", "-")
                raise UsageError(f"--{option} is for grippers with two jaws, not {what}")


def pose_noise(position_std: float | None, rotation_std_deg: float | None) -> PoseNoise:
    """Return the deviations of a pose, m and degrees; None for the usual ones."""
    from grasp.spatial.scoring.confidence import PoseNoise

    usual = PoseNoise()
    return PoseNoise(
        usual.position_std if position_std is None else position_std,
        usual.rotation_std if rotation_std_deg is None else math.radians(rotation_std_deg),
    )


def pose_options(command: F) -> F:
    """Add the options that say how uncertain a pose in space is."""
    for option in (
        seed_option,
        click.option(
            "--samples", default=100, show_default=True, help="Perturbed poses of each grasp."
        ),
        click.option(
            "--rotation-std-deg",
            type=float,
            help="Standard deviation of the rotation, degrees.  [default: 5.73]",
        ),
        click.option(
            "--position-std",
            type=float,
            help="Standard deviation of the position, m.  [default: 0.004]",
        ),
    ):
        command = option(command)
    return command


def result_options(command: F) -> F:
    """Add the options that say what is done with ranked grasps, apart from their number."""
    for option in (
        click.option(
            "--save-plots",
            type=click.Path(path_type=Path, file_okay=False),
            help="Folder to write a drawing to (SVG).",
        ),
        click.option(
            "--save-grasps",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Write the ranked grasps to this HDF5 file (ACRONYM's layout).",
        ),
        click.option(
            "--min-confidence",
            default=0.3,
            show_default=True,
            help="Below this confidence, advise against grasping.",
        ),
    ):
        command = option(command)
    return command
