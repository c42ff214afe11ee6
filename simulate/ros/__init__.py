"""A simulated robot in ROS 1 and ROS 2: sensors, TF, trajectories and the act service."""
