"""Results in the formats of other tools: tables, tracks for mapping and trajectory tools, ROS 2 logs."""
