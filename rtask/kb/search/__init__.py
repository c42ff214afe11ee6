"""Full-text and spatial search beside the store."""
