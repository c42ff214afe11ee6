"""Vectors of a network that the user brings (extra ``embed``): a feature beside SIFT."""
