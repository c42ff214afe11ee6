"""The simulated world: physics, products, tables and cameras."""
