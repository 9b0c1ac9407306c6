"""Friction between tyre and dry asphalt, as a share of the weight: two numbers, because two questions are asked."""

PEAK_FRICTION_COEFFICIENT = 0.9
"""Largest friction coefficient of good tyres on dry asphalt: a scenario whose vehicles need more is refused. Chosen by
hand above the 0.82 that the lead of `rear-end` needs to brake with 8 m/s^2."""
CONTROLLER_BRAKING_FRICTION_COEFFICIENT = 0.8
"""Friction coefficient that the controller of a replayed host may use, below the peak for safety. Chosen by hand
(docs/papers/song2016-choices.md)."""
