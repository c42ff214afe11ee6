"""Experiments: many independent trials on several processes, resumable, reproducible by seed."""
