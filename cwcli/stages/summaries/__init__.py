"""What the stages say at their end: the sections of their summaries."""
