"""The tables and figures of the papers from our own runs, one folder per paper, each printed number with a verdict."""
