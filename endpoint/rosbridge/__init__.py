"""rosbridge v2 over a websocket: robots talk to the graph as if it were a ROS node.

Gatto 2016, 3.2.4 puts the robot and the cloud on a rosbridge connection. No ROS is installed here;
what is spoken is the JSON protocol that roslibpy and roslib.js use unmodified.
"""
