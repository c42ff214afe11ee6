"""``rtask ros``: the graph in a robot's ROS."""
