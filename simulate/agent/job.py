"""What one robot of a demo is asked to do; light to import, as the parent process does."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Job"]


@dataclass(frozen=True)
class Job:
    """What one robot is to do.

    Parameters
    ----------
    name
        The robot's name, which is its token's agent.
    index
        Number of the robot; with ``seed`` it fixes its table, light and noise.
    url
        The endpoint.
    seed, objects
        Fix the products, the same for every robot of a demo.
    pictures
        Folder for the PNGs of each grasp.
    outbox
        File that keeps outcomes not yet delivered.
    robot
        Which robot it is: a name of :data:`simulate.robots.ROBOTS`.
    """

    name: str
    index: int
    url: str
    seed: int
    objects: int
    max_attempts: int
    pictures: str
    outbox: str
    gui: bool = False
    preset: str = "faithful"
    robot: str = "nao"
