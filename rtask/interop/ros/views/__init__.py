"""Views of a robot's camera as its messages bring them."""
