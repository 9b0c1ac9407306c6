"""A camera whose lens or mounting is assumed, as the log does not tell them, or whose lens the drive contradicts."""

from __future__ import annotations

from collections.abc import Iterator

from cwcli.evaluation.doubts.base import DoubtRule, Finding
from cwcli.evaluation.doubts.evidence import DoubtEvidence
from cwcli.pipeline.assumed_camera import (
    ASSUMED_LENS_NOTE_BEGINNING,
    ASSUMED_MOUNTING_NOTE_BEGINNING,
    CONTRADICTED_LENS_NOTE_BEGINNING,
)

MIN_ASSUMPTIONS_FOR_DOUBT = 1
"""Number of assumed properties from which the lanes are doubted. Chosen by hand: each changes every distance."""
NOTE_START_BY_ASSUMED_PROPERTY = {"lens": ASSUMED_LENS_NOTE_BEGINNING, "mounting": ASSUMED_MOUNTING_NOTE_BEGINNING}
"""Property of a camera that may be assumed -> the beginning of the note of `lanes` that says so."""


def find_assumed_camera(evidence: DoubtEvidence) -> Iterator[Finding]:
    """Yield that the lens is contradicted, else what of the camera is assumed."""
    notes = evidence.summary_of_stage("lanes").notes
    if any(note.startswith(CONTRADICTED_LENS_NOTE_BEGINNING) for note in notes):
        yield Finding(
            1.0, "As the car turns, the lane moves as another lens would show it: every distance may be wrong."
        )
        return
    assumed = [
        name for name, text in NOTE_START_BY_ASSUMED_PROPERTY.items() if any(note.startswith(text) for note in notes)
    ]
    if assumed:
        yield Finding(
            float(len(assumed)),
            f"The camera's {' and '.join(assumed)} are assumed, so every distance to the lane may be wrong."
            if len(assumed) > 1
            else f"The camera's {assumed[0]} is assumed, so every distance to the lane may be wrong.",
        )


ASSUMED_CAMERA_RULE = DoubtRule(
    summary="a camera whose lens or mounting is assumed, or whose lens the drive contradicts",
    threshold=MIN_ASSUMPTIONS_FOR_DOUBT,
    unit="",
    source="chosen: each changes every distance",
    advice="Record a calibration that fits the lens, and transforms; or give --camera-height and --camera-pitch, and "
    "--camera-fov where there is no calibration.",
    find=find_assumed_camera,
)
