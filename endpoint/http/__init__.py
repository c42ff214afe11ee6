"""HTTP messages, bodies, streams and errors, independent of any server."""
