"""Memory: recalled experience, confidence in grasps, and the choice of a grasp."""
