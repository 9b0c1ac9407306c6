"""Scenario -> truth -> sensors and V2X link, the same for the same seed; `stages/simulate*` writes the log."""
