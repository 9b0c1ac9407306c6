"""Simulation of a scenario: true motion, sensors and V2X link, the same for the same seed."""
