"""The node for ROS 2: a client of a server in the user's own ROS 2 environment.

It is a distribution of its own, ``rtask-ros2``: ``python -m rtask.cli.ros2.package`` copies this
folder and whatever it imports of ``rtask`` under another name, so nothing here may import a library
but numpy, websockets and rclpy, and the oldest Python is ROS 2 Humble's, 3.10.
"""
