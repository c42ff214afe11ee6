"""Calls that a robot's program makes: rules of repetition, an outbox, a held websocket."""
