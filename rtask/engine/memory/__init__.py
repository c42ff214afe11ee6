"""What the graph remembers: recalled experience, confidence and the choice of a grasp."""
