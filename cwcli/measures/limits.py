"""What a car can do at most: the assumptions that several measures share."""

from __future__ import annotations

BRAKING_MPS2 = 11.5
"""Commonroad vehicle 2, a BMW 320i on dry asphalt (Althoff et al. 2017)."""
LATERAL_MPS2 = 8.0
"""On dry asphalt (CommonRoad-CriMe)."""
MASS_SHARE = 0.5
"""Of the other in the mass of both: nobody sends masses, so they are taken as equal."""
