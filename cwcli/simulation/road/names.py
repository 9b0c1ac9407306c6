"""Names for the command line, without importing NumPy."""

WEATHERS = ("clear", "overcast", "shadow", "glare", "rain", "night", "night-rain", "fog")
"""The keys of `conditions.CONDITIONS`."""
