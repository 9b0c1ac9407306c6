"""From a scenario to the truth, and from that to sensors and a V2X link: the same for the same seed."""
