"""Second reading of goals: slots for what, where from and where to, filled around other words."""
