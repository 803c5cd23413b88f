"""Motion: one thread owns the robot, every target is checked, every wait ends."""
