"""Replays of recorded encounters with a braking controller or a driver model (song2016, section 4)."""
