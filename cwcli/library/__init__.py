"""The library for Python programs: logs, runs and their results. The commands call it; it prints nothing."""
