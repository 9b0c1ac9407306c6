"""Formats numbers, times and names for text formats."""

from __future__ import annotations

import re
from datetime import UTC, datetime

DEGREE_DECIMALS = 9
"""Decimals of an angle in degrees; chosen: 0.1 mm on the ground."""
FORBIDDEN_XML_CHARACTERS = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML 1.0 document may hold, not even escaped."""


def format_degrees(value: float) -> str:
    """Format an angle in degrees with nine decimals."""
    return f"{value:.{DEGREE_DECIMALS}f}"


def format_iso_time(stamp_ns: int) -> str:
    """Format a Unix time in ns as ISO 8601 in UTC with nine decimals."""
    return f"{datetime.fromtimestamp(stamp_ns // 10**9, UTC):%Y-%m-%dT%H:%M:%S}.{stamp_ns % 10**9:09d}Z"


def replace_forbidden_xml_characters(text: str) -> str:
    """Replace each character that an XML document may not hold by the replacement character."""
    return FORBIDDEN_XML_CHARACTERS.sub("\N{REPLACEMENT CHARACTER}", text)
