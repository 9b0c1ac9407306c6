"""The limits of a car's dynamics that several measures assume."""

from __future__ import annotations

CAR_BRAKING_LIMIT_MPS2 = 11.5
"""Hardest braking and acceleration of a car, m/s^2: CommonRoad vehicle 2, a BMW 320i on dry asphalt (Althoff et al.
2017)."""
CAR_LATERAL_LIMIT_MPS2 = 8.0
"""Largest lateral acceleration on dry asphalt (CommonRoad-CriMe)."""
