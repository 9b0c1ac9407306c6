"""The names of the weather conditions and of the rendered drives for the command line, without importing NumPy."""

WEATHER_NAMES = ("clear", "overcast", "shadow", "glare", "rain", "night", "night-rain", "fog")
"""Names of the weather conditions: the keys of `conditions.DRAW_FUNCTION_BY_WEATHER`."""
ROAD_SCENARIOS = {
    "road": (),
    "departure": ("drift=0.35", "duration_s=10"),
    "lane-drift": ("drift=-0.2", "duration_s=16"),
    "lane-change": ("lane_changes_per_min=6",),
}
"""Name of a rendered drive -> its values: any road, a car that leaves its lane to the left, one that drifts
slowly to the right, one that changes lanes. Chosen by hand: at its end the departing car is in its own lane still, so
that truth and search mean the same lane."""
