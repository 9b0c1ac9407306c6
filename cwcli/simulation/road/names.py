"""The names of the weather conditions for the command line, without importing NumPy."""

WEATHER_NAMES = ("clear", "overcast", "shadow", "glare", "rain", "night", "night-rain", "fog")
"""Names of the weather conditions: the keys of `conditions.CONDITIONS`."""
