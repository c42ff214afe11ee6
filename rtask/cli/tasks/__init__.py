"""Commands about tasks of robots."""
