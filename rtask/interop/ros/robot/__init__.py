"""The body of a robot: its model, the meshes that it names, and what of a view it covers."""
