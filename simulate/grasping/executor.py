"""Planning and execution of grasps in a world, and a robot at its table."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from simulate.grasping.attempt.run import AttemptRun
from simulate.grasping.planning import GraspPlanner
from simulate.grasping.record import GraspRecord
from simulate.grasping.rules import GraspRequest, PlannedGrasp
from simulate.motion.arm_space import ArmSpace
from simulate.motion.collision import Obstacle, PointField
from simulate.motion.stance import UPRIGHT, standing
from simulate.robots import RobotDescription, describe
from simulate.robots.description import Floats
from simulate.world.eyes import Eyes
from simulate.world.robot_body import RobotBody
from simulate.world.world import PlaceBox, World

__all__ = ["Executor", "GraspRecord", "GraspRequest", "PlannedGrasp", "Workcell"]

_ANY_STANCE = frozenset({"too_heavy", "too_wide"})


class Executor:
    """Plans and carries out grasps of one robot in its world.

    Parameters
    ----------
    world, robot
        The world and the robot that stands in it.
    eyes
        Cameras of the robot; None selects a perfect sensor in the standard light.
    boxes
        Boxes that the robot places into, by side, base frame; None = all of the world, for a robot
        that stands at the origin.
    furniture
        Boxes of others that stand in its way, base frame.

    Notes
    -----
    Planning sees the request, the caller's obstacles, and the furniture that the robot was set up
    with: the table and its boxes. Execution judges by the robot's fingers and eyes.
    """

    def __init__(
        self,
        world: World,
        robot: RobotBody,
        eyes: Eyes | None = None,
        *,
        boxes: Mapping[str, PlaceBox] | None = None,
        furniture: Sequence[PlaceBox] = (),
    ) -> None:
        self.world = world
        self.robot = robot
        self.eyes = eyes or Eyes(robot)
        self.boxes = world.place_boxes if boxes is None else boxes
        walls = [
            Obstacle.box("box", centre, size)
            for box in (*self.boxes.values(), *furniture)
            for centre, size in box.walls()
        ]
        self._furniture = walls
        self.space = ArmSpace(robot.description, walls)
        self.planner = GraspPlanner(self.space, box_for=self.box_for)
        self._planners = {UPRIGHT: self.planner}
        self._placed_before = dict.fromkeys(self.boxes, 0)

    def plan(
        self,
        request: GraspRequest,
        obstacles: Sequence[Obstacle | PointField | Floats] = (),
        seed: int = 0,
    ) -> PlannedGrasp | str:
        """Plan a grasp in the robot's present stance or, failing that, in another one.

        Parameters
        ----------
        request
            The requested grasp.
        obstacles
            Other objects: boxes, fields of points, or point clouds (n, 3), m, base frame, of one
            object each: upright prisms down to the table, or for a pose in space fields of points.
        seed
            Of every random choice of the planner.

        Returns
        -------
        PlannedGrasp or str
            The plan, or the reason code why there is none.
        """
        started = time.process_time()
        boxes: list[Obstacle | PointField] = []
        for obstacle in obstacles:
            if isinstance(obstacle, Obstacle | PointField):
                boxes.append(obstacle)
            elif len(obstacle) and request.pose is not None:
                boxes.append(PointField.of("neighbour", obstacle, request.table_height))
            elif len(obstacle):
                boxes.append(Obstacle.around("neighbour", obstacle, request.table_height))
        planned: PlannedGrasp | str = "ik"
        if request.stances != "other":
            planned = self.planner.plan(request, boxes, seed)
        if not isinstance(planned, str) or request.stances == "own" or planned in _ANY_STANCE:
            return planned
        for stance in self.robot.described.stances:
            leaning = self._planner(stance).plan(request, boxes, seed)
            if not isinstance(leaning, str):
                return replace(leaning, planning_s=time.process_time() - started)
        return planned

    @property
    def planning_work(self) -> int:
        """Number of postures that planning has evaluated so far, in all stances."""
        return sum(planner.space.work for planner in self._planners.values())

    def space_of(self, stance: str) -> ArmSpace:
        """Return the space of the arms in a stance."""
        return self._planner(stance).space

    def _planner(self, stance: str) -> GraspPlanner:
        if stance not in self._planners:
            space = ArmSpace(standing(self.robot.described, stance), self._furniture)
            self._planners[stance] = GraspPlanner(space, stance, self.box_for)
        return self._planners[stance]

    def execute(
        self,
        plan: PlannedGrasp,
        on_phase: Callable[[str], None] = lambda phase: None,
        *,
        place: bool = True,
    ) -> GraspRecord:
        """Execute a plan: grasp, lift, hold, place in the box on that side, go home.

        Parameters
        ----------
        plan
            From :meth:`plan`.
        on_phase
            Called with the name of each phase at its end.
        place
            If false, the object is put back at its original place instead.
        """
        run = self.begin(plan, on_phase)
        if run.grasp() == "ok":
            if place:
                run.place_in_box()
            else:
                run.put_back()
        return run.record

    def begin(
        self, plan: PlannedGrasp, on_phase: Callable[[str], None] = lambda phase: None
    ) -> AttemptRun:
        """Return a run of the plan, to be driven phase by phase; nothing moves yet."""
        return AttemptRun(self, plan, on_phase)

    def box_for(self, side: int, y: float) -> PlaceBox | None:
        """Return the box that an arm of a side (0 = both) uses for something at y m, if any."""
        return self.boxes.get("left" if (side or y) > 0 else "right")

    def next_spot(self, side: str) -> int:
        """Return how many objects were put into a box before, and count one more."""
        used = self._placed_before[side]
        self._placed_before[side] = used + 1
        return used


class Workcell:
    """A world with a table, a box on either side and a robot.

    Parameters
    ----------
    robot
        Name of a robot, or its description.
    preset, gui
        Of the :class:`~simulate.world.world.World`.

    Examples
    --------
    >>> with Workcell("nao", preset="fast") as cell:
    ...     sorted(cell.world.place_boxes)
    ['left', 'right']
    """

    def __init__(
        self, robot: str | RobotDescription, preset: str = "faithful", gui: bool = False
    ) -> None:
        self.description = describe(robot) if isinstance(robot, str) else robot
        self.world = World(preset, gui, self.description.workplace)
        self.world.add_table()
        for side in ("left", "right"):
            self.world.add_place_box(side)
        self.robot = RobotBody(self.world, self.description)
        self.executor = Executor(self.world, self.robot)

    def __enter__(self) -> Workcell:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def close(self) -> None:
        """End the physics."""
        self.world.close()
