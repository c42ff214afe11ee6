"""Commands that plan and learn grasps."""
