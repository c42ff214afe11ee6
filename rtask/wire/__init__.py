"""Declaration of a message, and everything that follows from it.

A request or an answer is declared once, as a class with typed fields. From the class follow the
check of what comes in, JSON Schema and OpenAPI 3.1, the ROS type descriptions of rosapi, and the
methods of the typed client.
"""
