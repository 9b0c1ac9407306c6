"""Noise that the user states for sensors whose messages state none (`--sigma`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cwcli.errors import UsageError, names_hint
from cwcli.estimation.measurements import QUANTITIES, Kind, Measurements
from cwcli.signals.role import Role

Sigmas = Mapping[str, tuple[float, ...]]
"""Role or topic -> one sigma, or two of an IMU: of its accelerometer and of its gyroscope."""
KIND_BY_ROLE = {
    Role.EGO_POSITION: Kind.POSITION,
    Role.EGO_VELOCITY: Kind.VELOCITY,
    Role.EGO_SPEED: Kind.SPEED,
    Role.EGO_HEADING: Kind.HEADING,
    Role.IMU: Kind.IMU,
}
"""Role -> the quantity whose noise is stated."""
DEGREES_SUFFIX = "deg"
"""Behind a number: it is in degrees, or degrees per second, instead of radians."""
MAX_SIGMA = 1e4
"""Greatest sigma that is accepted, in the unit of the quantity. Chosen to catch typing errors; not fitted."""


def parse_sigma_options(entries: Sequence[str]) -> Sigmas:
    """Return the sigmas of each source from `NAME=VALUE` entries.

    Raises:
        UsageError: An entry is malformed, or a source comes twice.
    """
    found: dict[str, tuple[float, ...]] = {}
    for entry in entries:
        name, _, text = entry.rpartition("=")
        sigmas = tuple(_parse_sigma_or_nan(part) for part in text.split("/"))
        if not name or len(sigmas) > 2 or not all(0.0 < sigma <= MAX_SIGMA for sigma in sigmas):
            raise UsageError(
                f"--sigma {entry!r} is not NAME=VALUE with a value above 0",
                hint="for example --sigma ego_speed=0.5, --sigma ego_heading=1deg or --sigma imu=0.05/0.1deg",
            )
        if name in found:
            raise UsageError(f"--sigma names {name} twice")
        found[name] = sigmas
    return found


def _parse_sigma_or_nan(text: str) -> float:
    """Parse one sigma; NaN where it is no number."""
    number = text.removesuffix(DEGREES_SUFFIX)
    try:
        value = float(number)
    except ValueError:
        return math.nan
    return value if number == text else math.radians(value)


def require_known_names_and_sigma_counts(sigmas: Sigmas, topics: Sequence[str], *, where: str) -> None:
    """Check that each name is a role that has a noise, or a topic of the log, and has as many values as it needs.

    Raises:
        UsageError: It is not.
    """
    roles = [role.value for role in KIND_BY_ROLE]
    for name, values in sigmas.items():
        if name not in roles and name not in topics:
            raise UsageError(
                f"--sigma {name}: neither a role nor a topic of the log",
                where=where,
                hint=names_hint(name, [*roles, *topics]),
            )
        if name in roles and (len(values) == 2) != (name == Role.IMU.value):
            raise UsageError(
                f"--sigma {name}: an IMU needs two values, other sensors one",
                hint="for example --sigma imu=0.05/0.1deg",
            )


def apply_stated_noise(measurements: Sequence[Measurements], role: Role, sigmas: Sigmas) -> list[Measurements]:
    """Return the measurements of a signal with the stated noise where its messages state none.

    Raises:
        UsageError: A topic has another number of values than its quantity needs.
    """
    done = []
    for each in measurements:
        stated = sigmas.get(each.source, sigmas.get(role.value))
        if stated is None or each.kind is not KIND_BY_ROLE[role]:
            done.append(each)
            continue
        if (len(stated) == 2) != (each.kind is Kind.IMU):
            raise UsageError(f"--sigma {each.source}: an IMU needs two values, other sensors one")
        width = QUANTITIES[each.kind].width
        per_value = np.repeat(np.square(stated), width // len(stated))
        covariance = np.tile(np.diag(per_value), (len(each.stamp_ns), 1, 1))
        if each.covariance is not None:
            has_noise = (np.diagonal(each.covariance, axis1=1, axis2=2) > 0.0).all(axis=1)
            covariance[has_noise] = each.covariance[has_noise]
        done.append(replace(each, covariance=covariance))
    return done
