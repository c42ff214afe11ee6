"""RTASK in ROS: its types, where ROS is installed, and the node."""
