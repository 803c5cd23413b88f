"""Drivers of robots behind one interface: UR arms, stages with GRBL, robots of cri."""
