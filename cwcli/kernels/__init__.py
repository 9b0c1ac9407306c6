"""The compiled loops: plain arrays in and out, no allocation inside. Each has a slow twin or another oracle."""
