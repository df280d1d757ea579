"""Outside engines on the same linkages: Pinocchio for torque and reactions, pylinkage for positions."""
