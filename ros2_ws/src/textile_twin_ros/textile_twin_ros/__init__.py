"""ROS 2 nodes of the textile machine twin: messages in, one session of the engine, messages out."""
