"""Noise that the user states for sensors whose messages state none (`--sigma`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.estimation.measurements import QUANTITY_BY_KIND, Kind, Measurements
from cwcli.lazy_dataclass import replace
from cwcli.signals.role import Role
from cwcli.text import parse_float_or_nan

Value = TypeVar("Value")
SigmasByRoleOrTopic = Mapping[str, tuple[float, ...]]
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
MAX_STATED_SIGMA = 1e4
"""Greatest sigma that is accepted, in the unit of the quantity. Chosen to catch typing errors; not fitted."""


def parse_values_by_name(
    option: str, entries: Sequence[str], parse_value: Callable[[str], Value | None], permitted: str, example: str
) -> dict[str, Value]:
    """Return the values of an option's `NAME=VALUE` entries by name; `parse_value` gives None for a wrong one.

    Raises:
        UsageError: An entry is malformed, or a name comes twice.
    """
    found: dict[str, Value] = {}
    for entry in entries:
        name, _, text = entry.rpartition("=")
        value = parse_value(text)
        if not name or value is None:
            raise UsageError(f"{option} {entry!r} is not {permitted}", hint=f"for example {option} {example}")
        if name in found:
            raise UsageError(f"{option} names {name} twice")
        found[name] = value
    return found


def parse_sigmas_by_role_or_topic(entries: Sequence[str]) -> SigmasByRoleOrTopic:
    """Return the sigmas of each source from `NAME=VALUE` entries.

    Raises:
        UsageError: An entry is malformed, or a source comes twice.
    """

    def parse_sigmas(text: str) -> tuple[float, ...] | None:
        numbers = [part.removesuffix(DEGREES_SUFFIX) for part in text.split("/")]
        values = [parse_float_or_nan(number) for number in numbers]
        sigmas = tuple(
            value if number == part else math.radians(value)
            for value, number, part in zip(values, numbers, text.split("/"), strict=True)
        )
        return sigmas if len(sigmas) <= 2 and all(0.0 < sigma <= MAX_STATED_SIGMA for sigma in sigmas) else None

    example = "ego_speed=0.5, --sigma ego_heading=1deg or --sigma imu=0.05/0.1deg"
    return parse_values_by_name("--sigma", entries, parse_sigmas, "NAME=VALUE with a value above 0", example)


def require_known_names_and_sigma_counts(sigmas: SigmasByRoleOrTopic, topics: Sequence[str], *, where: str) -> None:
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
                hint=hint_at_closest_or_all_known_names(name, [*roles, *topics]),
            )
        if name in roles and (len(values) == 2) != (name == Role.IMU.value):
            raise UsageError(
                f"--sigma {name}: an IMU needs two values, other sensors one",
                hint="for example --sigma imu=0.05/0.1deg",
            )


def fill_missing_noise_with_stated(
    measurements: Sequence[Measurements], role: Role, sigmas: SigmasByRoleOrTopic
) -> list[Measurements]:
    """Return the measurements of a signal with the stated noise where its messages state none.

    Raises:
        UsageError: A topic has another number of values than its quantity needs.
    """
    with_stated_noise = []
    for each in measurements:
        stated = sigmas.get(each.source, sigmas.get(role.value))
        if stated is None or each.kind is not KIND_BY_ROLE[role]:
            with_stated_noise.append(each)
            continue
        if (len(stated) == 2) != (each.kind is Kind.IMU):
            raise UsageError(f"--sigma {each.source}: an IMU needs two values, other sensors one")
        width = QUANTITY_BY_KIND[each.kind].width
        per_value = np.repeat(np.square(stated), width // len(stated))
        covariance = np.tile(np.diag(per_value), (len(each.stamp_ns), 1, 1))
        if each.covariance is not None:
            has_noise = (np.diagonal(each.covariance, axis1=1, axis2=2) > 0.0).all(axis=1)
            covariance[has_noise] = each.covariance[has_noise]
        with_stated_noise.append(replace(each, covariance=covariance))
    return with_stated_noise
