"""One attempt to grasp and place an object: phases, motion and looks."""
