"""What is assumed of a camera: the beginnings of the notes of `lanes`, which a doubt looks for in its record."""

from __future__ import annotations

ASSUMED_LENS_NOTE_BEGINNING = "no calibration for"
"""Beginning of the note that the lens is assumed."""
ASSUMED_MOUNTING_NOTE_BEGINNING = "the camera's mounting is not known"
"""Beginning of the note that the mounting is assumed."""
