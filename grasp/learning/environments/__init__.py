"""Small worlds with known returns, on which every learner is checked.

They are those of Hester and Stone, "TEXPLORE: real-time sample-efficient reinforcement learning for
robots", Machine Learning 90 (2013), which Gatto 2016, 3.3 builds on. Importing this package
registers them and the grasp problem with gymnasium, so that ``gymnasium.make`` knows them by name;
so does ``import rtask`` after ``import gymnasium``.
"""

from grasp.learning.environments.delayed import DelayedActions
from grasp.learning.environments.discretise import Bins
from grasp.learning.environments.mountain_car import MountainCar
from grasp.learning.environments.taxi import Taxi
from grasp.learning.environments.two_rooms import TwoRooms
from grasp.learning.registration import register

__all__ = ["Bins", "DelayedActions", "MountainCar", "Taxi", "TwoRooms"]

register()
