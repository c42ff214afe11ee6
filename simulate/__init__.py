"""Robots in a physics simulator: description, camera, planning, execution, the agent."""
