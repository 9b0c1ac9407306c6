"""Friction between tyre and dry asphalt, as a share of the weight: two numbers, because two questions are asked."""

PEAK_FRICTION = 0.9
"""What good tyres give at most: a scenario whose vehicles need more can't be driven. (The lead of
`rear-end` brakes with 8 m/s^2, which is 0.82.)"""
BRAKING_FRICTION = 0.8
"""With something in hand: what a controller of a replayed host may count on (docs/papers/song2016-choices.md)."""
