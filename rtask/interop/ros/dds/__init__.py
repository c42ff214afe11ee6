"""Topics and services of ROS 2 by DDS, without ROS 2 (extra ``dds``)."""
