"""What a number means: canonical columns with units and frames, role binding, V2X messages, geodesy, clocks."""
