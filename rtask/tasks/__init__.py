"""Plans for tasks of robots, from what the graph knows: ``kb.tasks``."""

from rtask.tasks.plan import PlannedStep, Refusal, Support, TaskPlan
from rtask.tasks.tasks import Tasks

__all__ = ["PlannedStep", "Refusal", "Support", "TaskPlan", "Tasks"]
