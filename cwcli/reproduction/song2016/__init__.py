"""The reproduction of song2016: its table 1, its prediction figures, its warnings and its control."""
