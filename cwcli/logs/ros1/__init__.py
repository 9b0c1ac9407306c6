"""ROS 1 bags: their records, chunks and definitions, and their messages as CDR."""
