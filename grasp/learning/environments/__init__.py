"""Small worlds with known returns, on which every learner is checked.

They are those of Hester and Stone, "TEXPLORE: real-time sample-efficient reinforcement learning for
robots", Machine Learning 90 (2013), which Gatto 2016, 3.3 builds on. Importing this package
registers them and the grasp problem with gymnasium, so that ``gymnasium.make`` knows them by name.
"""

import gymnasium

from grasp.learning.environments.delayed import DelayedActions
from grasp.learning.environments.discretise import Bins
from grasp.learning.environments.mountain_car import MountainCar
from grasp.learning.environments.taxi import Taxi
from grasp.learning.environments.two_rooms import TwoRooms

__all__ = ["Bins", "DelayedActions", "MountainCar", "Taxi", "TwoRooms"]

for _world in (MountainCar, Taxi, TwoRooms):
    gymnasium.register(
        f"rtask/{_world.__name__}-v0",
        f"{_world.__module__}:{_world.__name__}",
        max_episode_steps=_world.max_steps,
    )
# These two cut their episodes off themselves.
gymnasium.register(
    "rtask/Grasp-v0", "grasp.learning.environments.simulated_grasps:grasp_environment"
)
gymnasium.register(
    "rtask/SimulatedGrasps-v0", "grasp.learning.environments.simulated_grasps:SimulatedGrasps"
)
