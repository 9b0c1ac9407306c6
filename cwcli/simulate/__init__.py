"""From a scenario to a log: the writers of simulated sensors, V2X messages and camera frames."""
