"""Triangle meshes: files, plain bodies, and rays through them."""
