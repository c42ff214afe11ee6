"""Logs, audit trail, metrics and health checks."""
