"""textile-twin: digital twins of textile machines, from the angle of the main shaft to torque, needle and reactions."""
