"""An annotated log as a log of ROS 2 messages alone."""
