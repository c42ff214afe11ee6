"""Why a grasp or a step failed, and the smallest change under which it would have held.

Causes are hypotheses that each say how likely an attempt is to hold. The reason that the robot
reported, what the graph knows of the hand, the thing and its place, and the outcomes of all robots
make them more or less likely; the same hypotheses predict what a change would have done.
"""

from rtask.tasks.diagnosis.diagnosis import Cause, Diagnosis, beliefs_of, diagnose

__all__ = ["Cause", "Diagnosis", "beliefs_of", "diagnose"]
