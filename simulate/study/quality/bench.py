"""A table with one object on it and a hand without an arm: grasps are carried out and judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from features.geometry import pose_matrix
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.confidence import PoseNoise
from rtask.scratch import ScratchFolder
from simulate.grasping.floating.execution import Conditions, Held, execute, settle, spawn_parts
from simulate.robots.description import Floats
from simulate.study.quality.objects import GraspObject
from simulate.world.objects import Friction
from simulate.world.seeds import mix_seed, stream
from simulate.world.world import BodyPose, World

__all__ = ["Bench", "Draw", "draws", "laid_out"]

_PLACE = (0.34, 0.0)
_ERRORS, _OTHERS = 31, 32
_FRICTION = (0.35, 0.8)
_COM_SHARE = 0.05
_TABLE = Support(0.0)


@dataclass(frozen=True, eq=False)
class Draw:
    """The conditions of a trial, the same for all grasps of an object.

    Parameters
    ----------
    error : (4, 4)
        Of the gripper's pose, in its own frame.
    conditions
        Of the physics.
    """

    error: Floats
    conditions: Conditions


def draws(seed: int, number: int, count: int, size_m: float) -> list[Draw]:
    """Return the trials of one object.

    Poses are off by 4 mm and .1 rad, frictions even between .35 and .8, centres of mass off by 5 %
    of the object's size (standard deviations of each component).
    """
    errors = PoseNoise().transforms(count, mix_seed(seed, _ERRORS, number))
    rng = stream(seed, _OTHERS, number)
    draws = []
    for error in errors:
        off = rng.normal(0, _COM_SHARE * size_m, 3)
        conditions = Conditions(
            float(rng.uniform(*_FRICTION)), (float(off[0]), float(off[1]), float(off[2])), True
        )
        draws.append(Draw(error, conditions))
    return draws


@dataclass(frozen=True, eq=False)
class Bench:
    """An object at rest on the table.

    Parameters
    ----------
    item
        The object.
    mesh
        Of it, in its own frame: the origin is the centre of mass.
    world, body, rest
        Of the physics.
    """

    item: GraspObject
    mesh: Mesh
    world: World
    body: int
    rest: BodyPose

    @property
    def world_from_object(self) -> Floats:
        """Pose of the object (4, 4)."""
        return pose_matrix(self.rest.rotation, self.rest.position)

    @property
    def around(self) -> Surroundings:
        """The table in the object's frame."""
        x, y, z = (float(v) for v in self.rest.rotation.T @ [0.0, 0.0, 1.0])
        return Surroundings(Support(-self.rest.z, (x, y, z)))

    def try_out(
        self, candidate: GraspCandidate, gripper: ParallelGripper, trials: Sequence[Draw]
    ) -> list[Held]:
        """Carry out a grasp of the object's frame once in each trial."""
        opening = candidate.opening or gripper.max_opening
        outcomes = []
        for trial in trials:
            pose = self.world_from_object @ candidate.frame_from_gripper @ trial.error
            # The error is the object's; where the table is, is known.
            low = _TABLE.below(pose[None], gripper.boxes(opening)[None])[0]
            pose[2, 3] += max(_TABLE.clearance - low, 0.0)
            outcomes.append(
                execute(
                    self.world, self.body, gripper, pose, opening, self.rest,
                    conditions=trial.conditions,
                )
            )  # fmt: skip
        return outcomes


@contextmanager
def laid_out(item: GraspObject, preset: str = "fast") -> Iterator[Bench]:
    """Let an object come to rest on a table."""
    friction = Friction(lateral=0.5, rolling=0.0004)
    with ScratchFolder("parts") as folder, World(preset) as world:
        world.add_table(0.0)
        body = spawn_parts(world, item.write(folder), item.mass, friction=friction)
        low = min(float(part[:, 2].min()) for part in item.parts)
        place = (*_PLACE, 0.002 - low)
        world.client.resetBasePositionAndOrientation(body, place, (0, 0, 0, 1))
        yield Bench(item, item.mesh(), world, body, settle(world, body))
