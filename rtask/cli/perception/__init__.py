"""Commands on point clouds and images."""
