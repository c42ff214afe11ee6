"""rosbridge v2 over a websocket: to robots, the graph is a ROS node.

Gatto 2016, 3.2.4, connects robot and cloud by rosbridge. No ROS is installed here: the server
speaks the JSON protocol itself, which roslibpy and roslib.js use unmodified.
"""
