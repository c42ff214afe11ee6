"""``rtask ros2``: the graph in a robot's ROS 2."""
