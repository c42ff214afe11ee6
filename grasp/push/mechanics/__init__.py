"""Contact, closure and quasi-static simulation of a push grasp."""
