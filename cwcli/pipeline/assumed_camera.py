"""What of a camera is assumed or contradicted: how notes of `lanes` begin, which a doubt looks for in its record."""

from __future__ import annotations

ASSUMED_LENS_NOTE_BEGINNING = "no calibration for"
"""Beginning of the note that the lens is assumed."""
ASSUMED_MOUNTING_NOTE_BEGINNING = "the camera's mounting is not known"
"""Beginning of the note that the mounting is assumed."""
CONTRADICTED_LENS_NOTE_BEGINNING = "the way in which the lane moves as the car turns fits"
"""Beginning of the note that the drive contradicts the lens."""
