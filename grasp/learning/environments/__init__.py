"""Small worlds with known returns, on which every learner is checked.

They are those of Hester and Stone, "TEXPLORE: real-time sample-efficient reinforcement learning for
robots", Machine Learning 90 (2013), which Gatto 2016, 3.3 builds on.
"""

from grasp.learning.environments.discretise import Bins
from grasp.learning.environments.mountain_car import MountainCar
from grasp.learning.environments.taxi import Taxi
from grasp.learning.environments.two_rooms import TwoRooms

__all__ = ["Bins", "MountainCar", "Taxi", "TwoRooms"]
