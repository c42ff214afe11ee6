"""Learners of Gatto 2016, 3.3: Q-learning, Sarsa, Dyna, R-MAX and TEXPLORE, behind one interface.

The learner that chooses grasps by default is :mod:`grasp.learning.bandit`.
"""

from grasp.learning.agents.dyna import Dyna
from grasp.learning.agents.q_learning import QLearning
from grasp.learning.agents.rmax import RMax
from grasp.learning.agents.run import Episode, run_episode, run_episodes
from grasp.learning.agents.sarsa import Sarsa

__all__ = ["Dyna", "Episode", "QLearning", "RMax", "Sarsa", "run_episode", "run_episodes"]
