"""Derivations that take long, made in a forked copy of this process and adopted by it."""
