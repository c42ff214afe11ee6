"""The act service (Gatto 2016, 4.3): go there, grasp, place; and the interface that tests it."""
