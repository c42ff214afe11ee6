"""Topics of ROS 2 by Zenoh, in the form of its middleware rmw_zenoh; not tested against ROS 2."""
