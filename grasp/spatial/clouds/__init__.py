"""Point clouds prepared for grasp planning."""
