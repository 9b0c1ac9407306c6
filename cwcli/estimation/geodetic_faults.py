"""What may be wrong with latitude and longitude as such; the map is another one without the fault."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cwcli.estimation.contradiction import SourceQuantity
from cwcli.estimation.correction import Correction
from cwcli.estimation.measurements import Kind
from cwcli.estimation.result import Track
from cwcli.lazy_dataclass import dataclass, replace
from cwcli.signals.canonical import PositionSignal

MAX_LATITUDE_DEG = 90.0
"""Latitude of a pole, degrees."""
MAX_LONGITUDE_DEG = 180.0
"""Longitude of the antimeridian, degrees."""


@dataclass(frozen=True)
class GeodeticFault:
    """A fault of latitude and longitude.

    Attributes:
        name, fault, action: As in `Correction`.
        correct: Converts wrong fixes to right ones.
        needs_vote: Whether it is tried only where several sources outvote the fixes, because any fixes may have it.
    """

    name: str
    fault: str
    action: str
    correct: Callable[[PositionSignal], PositionSignal]
    needs_vote: bool = True

    def are_corrected_fixes_on_earth(self, signal: PositionSignal) -> bool:
        """Whether the corrected fixes are places on the earth."""
        corrected = self.correct(signal)
        return all(
            bool((np.abs(degrees[np.isfinite(degrees)]) <= limit_deg).all())
            for degrees, limit_deg in (
                (corrected.latitude_deg, MAX_LATITUDE_DEG),
                (corrected.longitude_deg, MAX_LONGITUDE_DEG),
            )
        )

    def correction_of(self, signal: PositionSignal) -> Correction:
        """Return the correction of all fixes of a topic."""
        return Correction(
            SourceQuantity(signal.source, Kind.POSITION),
            self.name,
            self.fault,
            self.action,
            "without that it agrees with the others",
            n_rows=len(signal.stamp_ns),
        )


GEODETIC_FAULTS = (
    GeodeticFault(
        "latitude-longitude",
        "has latitude and longitude exchanged",
        "exchanged back",
        lambda s: replace(s, latitude_deg=s.longitude_deg, longitude_deg=s.latitude_deg),
    ),
    GeodeticFault(
        "longitude-sign",
        "has longitudes with the wrong sign",
        "sign changed",
        lambda s: replace(s, longitude_deg=-s.longitude_deg),
    ),
    GeodeticFault(
        "latitude-sign",
        "has latitudes with the wrong sign",
        "sign changed",
        lambda s: replace(s, latitude_deg=-s.latitude_deg),
    ),
    GeodeticFault(
        "radians",
        "has latitude and longitude in radians",
        "converted to degrees",
        lambda s: replace(s, latitude_deg=np.degrees(s.latitude_deg), longitude_deg=np.degrees(s.longitude_deg)),
        needs_vote=False,  # only fixes within 3 degrees of 0 degrees north and east, which lies at sea, may have it
    ),
)
"""Faults of latitude and longitude, in the order in which they are tried."""


def is_position_doubted(track: Track, topic: str) -> bool:
    """Whether other sources outvote the fixes of a topic, or their axes in the map were corrected."""
    who = SourceQuantity(topic, Kind.POSITION)
    return any(each.who == who and each.allies for each in track.contradictions) or any(
        each.who == who for each in track.corrections
    )


def is_position_contradicted(track: Track, topic: str) -> bool:
    """Whether the fixes of a topic are one side of a contradiction."""
    who = SourceQuantity(topic, Kind.POSITION)
    return any(who in (each.who, each.against) for each in track.contradictions)


def topics_corrected_or_blamed(track: Track) -> set[str]:
    """Return the topics that were corrected or blamed."""
    return {each.who.source for each in track.contradictions} | {each.who.source for each in track.corrections}
