"""Factors between units."""

NS_PER_S = 1_000_000_000
"""The nanoseconds in a second."""
S_PER_NS = 1e-9
"""The seconds in a nanosecond."""
NS_PER_MS = 1_000_000
"""The nanoseconds in a millisecond."""
NS_PER_DAY = 86_400 * NS_PER_S
"""The nanoseconds in a day."""
MPS_PER_KMH = 1.0 / 3.6
"""One km/h in m/s."""
KMH_PER_MPS = 3.6
"""Kilometres per hour in a metre per second."""
STANDARD_GRAVITY_MPS2 = 9.80665
"""The standard acceleration of gravity, in m/s^2 (ISO 80000-3)."""
