"""A failure tried again on a branch of the graph, with one fact changed.

The graph itself is never written: each try makes a branch, states the changed fact there, lets the
ordinary planner plan and the ordinary executors carry out, and drops the branch. What hides in the
thing is drawn from the causes that the graph believes in, so that each answer is conditional on
that belief.
"""

from simulate.tasks.trials.result import ChangeTrial, TriedChange
from simulate.tasks.trials.trial import Branches, TrialOptions, require_keep, try_changes

__all__ = ["Branches", "ChangeTrial", "TrialOptions", "TriedChange", "require_keep", "try_changes"]
