"""Push grasps by an arm: Object M of Kehoe 2014, 3.7, and parts printed like it."""
