"""What a number means: canonical columns with units and frames, message types, V2X messages, geodesy, clocks."""
