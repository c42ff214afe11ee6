"""Robots' current activity, in words: connections, calls, camera pictures, outcomes."""
