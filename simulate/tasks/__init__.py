"""Stored plans carried out: robots take steps from the queue, look, act, report, and plan again."""
