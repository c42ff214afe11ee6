"""What stands in for the objects, images and outlines that the theses did not publish."""
