"""A simulated robot in ROS 1: sensors, TF, trajectories and the act service."""
