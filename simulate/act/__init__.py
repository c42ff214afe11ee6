"""The act service (Gatto 2016, 4.3): reach, grasp and place at a goal pose; its tests."""
