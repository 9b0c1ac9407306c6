"""Do planted shifts come back, and do windows agree? `python -m tests.studies.latency_planted ../shared/logs`.

Nobody knows the latencies of real logs, but what is added to one source's stamps must be added to its latency: within
10 ms or twice the said sigma. Where nothing is found, the bound (the least sigma that any estimator without bias could
have) must be above 50 ms. And latencies of separate windows of one log must agree within their sigmas: the reduced
chi-square of all windows of a length together is below 2.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cwcli.errors import CwcliError
from cwcli.estimation import EstimatorConfig, Measurements, estimate_track
from cwcli.estimation.from_signals import ego_signal_to_measurements
from cwcli.estimation.latency import Latency, LatencyStatus
from cwcli.logs.read.reader import Log
from cwcli.signals.geodesy import LocalMap
from cwcli.signals.role import Role
from cwcli.stages.estimate import EGO_SENSOR_ROLES
from cwcli.stages.inputs.sources import SourceConfig, read_sensor_signals
from tests.studies.latency import FOUND, against

SHIFTS_MS = (-100.0, 50.0, 100.0, 300.0)
WINDOWS_S = (20.0, 30.0, 40.0, 60.0)
TOLERANCE_MS = 10.0
OBSERVABLE_MS = 50.0
MIN_SHARE = 0.95
MAX_CHI_SQUARE = 2.0

Latencies = dict[str, Latency]
"""Source and quantity -> its latency."""


@dataclass(frozen=True)
class Planted:
    """One shift of one source.

    Attributes:
        log, pair: Where: the moved source's quantity and the one that it is compared with.
        shift_ms: What was added to its stamps.
        before, after: The latency between the two without and with the shift.
    """

    log: str
    pair: str
    shift_ms: float
    before: Latency
    after: Latency

    @property
    def is_found(self) -> bool:
        """Both have a value."""
        return self.before.status in FOUND and self.after.status in FOUND

    @property
    def error_ms(self) -> float:
        """Error of the difference between the two latencies that were found, ms."""
        return 1e3 * (self.after.found_s - self.before.found_s) - self.shift_ms

    @property
    def is_right(self) -> bool:
        """Whether the difference is within the bounds, or rightly not found."""
        if not self.is_found:
            return min(1e3 * told.bound_s for told in (self.before, self.after)) > OBSERVABLE_MS
        return abs(self.error_ms) <= max(TOLERANCE_MS, 2e3 * self.after.sigma_s)


def read(path: Path) -> list[Measurements]:
    """The ego's measurements of a log."""
    with Log.open(path) as log:
        sources = read_sensor_signals(
            log, SourceConfig(), command="estimate", required=(Role.EGO_POSITION,), optional=EGO_SENSOR_ROLES[1:]
        )
    (position, *_) = sources.by_role[Role.EGO_POSITION]
    place = (position.latitude_deg[0], position.longitude_deg[0], np.nan_to_num(position.altitude_m[0]))  # type: ignore[attr-defined]
    local_map = LocalMap(*map(float, place))
    signals = [signal for role in EGO_SENSOR_ROLES for signal in sources.by_role.get(role, ())]
    return [m for signal in signals for m in ego_signal_to_measurements(signal, local_map)]


def latencies(measurements: Sequence[Measurements]) -> Latencies:
    """What the estimator says; an IMU's two quantities are one source."""
    track = estimate_track(measurements, EstimatorConfig(rate_hz=1.0))
    return {f"{r.source} {r.kind.name.lower()}": r.latency for r in track.sources}


def moved(measurements: Sequence[Measurements], source: str, shift_ms: float) -> list[Measurements]:
    """The same with one source's stamps moved."""
    shift_ns = round(1e6 * shift_ms)
    return [replace(m, stamp_ns=m.stamp_ns + shift_ns) if m.source == source else m for m in measurements]


def planted(name: str, measurements: Sequence[Measurements]) -> list[Planted]:
    """Every shift of every source against the log as it is.

    A latency is one between two sources, of each the first quantity.
    """
    before = latencies(measurements)
    found = []
    for source in dict.fromkeys(m.source for m in measurements):
        for shift_ms in SHIFTS_MS:
            after = latencies(moved(measurements, source, shift_ms))
            first = {of(q): q for q in reversed(before)}
            own = first.pop(source)
            for other in first.values():
                if LatencyStatus.REFERENCE in (before[own].status, before[other].status):
                    told, now = (against(latency[own], latency[other]) for latency in (before, after))
                    found.append(Planted(name, f"{own} - {other}", shift_ms, told, now))
    return found


def of(quantity: str) -> str:
    """The source of a quantity."""
    return quantity.rpartition(" ")[0]


def show_planted(found: Sequence[Planted]) -> bool:
    """Print the table of the shifts; whether enough are right."""
    print("| log | moved | by [ms] | latency before [ms] | after [ms] | error | 2 sigma | bound | |")
    print("|---|---|---|---|---|---|---|---|---|")
    for p in found:
        said = " | ".join(
            f"{1e3 * told.found_s:.0f} +- {1e3 * told.sigma_s:.0f} {told.status.value}" for told in (p.before, p.after)
        )
        print(
            f"| {p.log} | {p.pair} | {p.shift_ms:g} | {said} | {p.error_ms:.1f} | {2e3 * p.after.sigma_s:.0f} "
            f"| {1e3 * p.after.bound_s:.0f} | {'' if p.is_right else 'wrong'} |"
        )
    n_right, n_found = sum(p.is_right for p in found), sum(p.is_found for p in found)
    n_close = sum(p.is_found and abs(p.error_ms) <= TOLERANCE_MS for p in found)
    print(f"\nright: {n_right} of {len(found)}; found {n_found}, of them within {TOLERANCE_MS:g} ms {n_close}\n")
    return n_right >= MIN_SHARE * len(found)


def windows(measurements: Sequence[Measurements], length_s: float) -> list[Latencies]:
    """The latencies of each window of a log."""
    positions = next(m for m in measurements if len(m))
    first_ns, last_ns = int(positions.stamp_ns.min()), int(positions.stamp_ns.max())
    found = []
    for k in range(int((last_ns - first_ns) / 1e9 / length_s)):
        begin_ns = first_ns + round(1e9 * k * length_s)
        end_ns = begin_ns + round(1e9 * length_s)
        cut = [m.select_rows((m.stamp_ns >= begin_ns) & (m.stamp_ns < end_ns)) for m in measurements]
        try:
            found.append(latencies([m for m in cut if len(m)]))
        except CwcliError:
            continue  # no position in it
    return found


def show_windows(name: str, measurements: Sequence[Measurements]) -> bool:
    """Print the windows' latencies and their reduced chi-square; whether it is small enough."""
    is_small = True
    whole = latencies(measurements)
    for length_s in WINDOWS_S:
        found = windows(measurements, length_s)
        for quantity, status in ((quantity, latency.status) for quantity, latency in whole.items()):
            told = [w[quantity] for w in found if quantity in w and w[quantity].status in FOUND]
            if len(told) < 2:
                continue
            value, sigma = np.array([t.found_s for t in told]), np.array([t.sigma_s for t in told])
            mean = (value / sigma**2).sum() / (sigma**-2.0).sum()
            chi_square = float((((value - mean) / sigma) ** 2).sum() / (len(told) - 1))
            listed = ", ".join(f"{1e3 * v:.0f} +- {1e3 * s:.0f}" for v, s in zip(value, sigma, strict=True))
            print(
                f"| {name} | {quantity} ({status.value}) | {length_s:g} | {len(told)} | {chi_square:.2f} | {listed} |",
                flush=True,
            )
            is_small &= chi_square < MAX_CHI_SQUARE
    return is_small


def main() -> int:
    """Print the tables; 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=Path, help="folder with the logs")
    options = parser.parse_args()
    logs: dict[str, list[Measurements]] = {}
    for path in sorted(options.logs.glob("*.mcap")):
        try:
            measurements = read(path)
        except CwcliError as error:
            print(f"{path.name} left out: {error}", file=sys.stderr)
            continue
        if len({m.source for m in measurements}) > 1:
            logs[path.name.split(".")[0]] = measurements
    is_right = show_planted([p for name, measurements in logs.items() for p in planted(name, measurements)])
    print("| log | quantity (status in the whole log) | window [s] | found in | chi-square | latencies [ms] |")
    print("|---|---|---|---|---|---|")
    are_small = [show_windows(name, measurements) for name, measurements in logs.items()]
    return 0 if is_right and all(are_small) else 1


if __name__ == "__main__":
    sys.exit(main())
