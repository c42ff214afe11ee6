"""Robotics and automation as a service (Kehoe 2014, chapter 5).

Algorithms are offered as services: their methods are checked, queued, carried out by workers and
reached over HTTP, rosbridge and the client, from one declaration.
"""

from __future__ import annotations

from rtask.services.call import Call
from rtask.services.host import ServiceHost
from rtask.services.service import Service, data_resource, method, shutdown, startup

__all__ = ["Call", "Service", "ServiceHost", "data_resource", "method", "shutdown", "startup"]
