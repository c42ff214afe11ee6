"""TEXPLORE (Hester and Stone 2013): a random forest as model, Monte Carlo tree search as planner.

The learner of Gatto 2016, 3.3.4.
"""

from grasp.learning.agents.texplore.agent import Texplore, TexploreSettings
from grasp.learning.agents.texplore.realtime import RealTimeTexplore

__all__ = ["RealTimeTexplore", "Texplore", "TexploreSettings"]
