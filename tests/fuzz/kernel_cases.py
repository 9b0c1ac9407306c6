"""Cases of the level `kernel`."""

from __future__ import annotations

from tests.fuzz.decoding import check_messages
from tests.fuzz.messages import make_messages
from tests.fuzz.mutate import Rng
from tests.fuzz.scanning import check_scan

SCANS = 0.1


def check_case(rng: Rng) -> dict[str, int]:
    """Make a case and check it; counts of its inputs."""
    if rng.random() < SCANS:
        return check_scan(rng)
    case = make_messages(rng)
    accepted, compared = check_messages(case)
    return {"inputs": len(case.payloads), "accepted": accepted, "compared": compared}
