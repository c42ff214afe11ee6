"""Names of our environments in gymnasium, which looks for no plugins since 1.0."""

from __future__ import annotations

__all__ = ["ENVIRONMENTS", "refuse_rendering", "register"]

ENVIRONMENTS: dict[str, tuple[str, int | None]] = {
    "rtask/MountainCar-v0": ("grasp.learning.environments.mountain_car:MountainCar", 1000),
    "rtask/Taxi-v0": ("grasp.learning.environments.taxi:Taxi", 1000),
    "rtask/TwoRooms-v0": ("grasp.learning.environments.two_rooms:TwoRooms", 1000),
    # These two cut their episodes off themselves.
    "rtask/Grasp-v0": ("grasp.learning.environments.simulated_grasps:grasp_environment", None),
    "rtask/SimulatedGrasps-v0": (
        "grasp.learning.environments.simulated_grasps:SimulatedGrasps",
        None,
    ),
}
"""Where each is made, and after how many steps an episode is cut off."""


def register() -> None:
    """Tell gymnasium the names of those that it does not know yet; imports none of them."""
    import gymnasium

    for name, (made_by, most) in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, made_by, max_episode_steps=most)


def refuse_rendering(mode: str | None) -> None:
    """Refuse a mode of rendering, as none of these environments draws anything.

    Raises
    ------
    gymnasium.error.UnsupportedMode
        Whichever mode it is.
    """
    import gymnasium

    if mode is not None:
        raise gymnasium.error.UnsupportedMode(
            f"render_mode {mode!r}: this environment has no picture, its render_modes are []; "
            "leave render_mode out"
        )
