"""SVG figures of plans and their grasps."""
