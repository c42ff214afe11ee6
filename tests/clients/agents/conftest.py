"""The session is a program for an interpreter that has the SDK; no test imports it."""

collect_ignore = ["official_session.py"]
