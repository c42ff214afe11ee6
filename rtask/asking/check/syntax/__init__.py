"""Text of a query as an outline of its patterns, and terms as a query writes them."""
