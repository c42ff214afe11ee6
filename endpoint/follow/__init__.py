"""Change notifications over server-sent events and websockets."""
