"""Settings of the estimator: one set of defaults for every log; whatever differs is found from the log itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Annotated, Literal

from cwcli.errors import UsageError, hint_at_closest_or_all_known_names
from cwcli.estimation.calibration import Calibration
from cwcli.estimation.stated_noise import SigmasByRoleOrTopic, parse_sigmas_by_role_or_topic, parse_values_by_name
from cwcli.lazy_dataclass import dataclass
from cwcli.option import Option
from cwcli.text import parse_float_or_nan

ModelName = Literal["cwcli", "song2016"]
SensorModelOption = Literal["auto", "none"]
Senders = Literal["plain", "j2945"]
LatencyOption = Literal["auto", "none"] | Mapping[str, float]
LeverArms = Mapping[str, tuple[float, float]]
"""Source -> lever arm: m ahead and to the left of the reference point, whose course is the heading."""
MAX_LONGITUDINAL_LEVER_ARM_M, MAX_LATERAL_LEVER_ARM_M = 20.0, 5.0
"""Greatest lever arm ahead and to the left that is accepted, m. Chosen beyond the size of any lorry; not fitted."""
MS_PER_S = 1000.0
"""Milliseconds in a second."""
MAX_LATENCY_OPTION_S = 3600.0
"""Greatest latency that is accepted as an option, s. Chosen to catch values in a wrong unit."""


def parse_latency_option(entries: Sequence[str]) -> LatencyOption:
    """Return `auto`, `none`, or the latency (s) of each source from `NAME=MS` entries.

    Raises:
        UsageError: An entry is malformed, a source comes twice, or entries contradict each other.
    """
    if list(entries) in ([], ["auto"]):
        return "auto"
    if list(entries) == ["none"]:
        return "none"

    def parse_ms(text: str) -> float | None:
        latency_s = parse_float_or_nan(text.removesuffix("ms")) / MS_PER_S
        return latency_s if abs(latency_s) <= MAX_LATENCY_OPTION_S else None

    return parse_values_by_name("--latency", entries, parse_ms, "auto, none or NAME=MS", "/gps/fix=80")


def parse_lever_arm_options(entries: Sequence[str]) -> LeverArms:
    """Return the lever arm (m ahead, m to the left) of each source from `NAME=AHEAD,LEFT` entries.

    Raises:
        UsageError: An entry is malformed or off the car, or a source comes twice.
    """

    def parse_ahead_and_left_m(text: str) -> tuple[float, float] | None:
        parts = [parse_float_or_nan(part) for part in text.split(",")]
        return (parts[0], parts[1]) if len(parts) == 2 and is_lever_arm_on_car(*parts) else None

    permitted = f"NAME=AHEAD,LEFT in metres, at most {MAX_LONGITUDINAL_LEVER_ARM_M:g} and {MAX_LATERAL_LEVER_ARM_M:g}"
    return parse_values_by_name("--lever-arm", entries, parse_ahead_and_left_m, permitted, "/gps/fix=1.2,0")


def parse_source_units(entries: Sequence[str]) -> Mapping[str, str]:
    """Return the unit or convention of each source from `TOPIC=UNIT` entries.

    Raises:
        UsageError: An entry is malformed, a source comes twice, or there is no such unit.
    """
    from cwcli.estimation.hypotheses import UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND

    known = {each.name for own in UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND.values() for each in own}
    found: dict[str, str] = {}
    for entry in entries:
        topic, _, unit = entry.partition("=")
        if not topic or not unit:
            raise UsageError(f"--as {entry!r} is not TOPIC=UNIT", hint="for example --as /vehicle/velocity=km/h")
        for part in unit.split("+"):
            if part not in known:
                raise UsageError(
                    f"--as {entry}: there is no unit or convention {part!r}",
                    hint=hint_at_closest_or_all_known_names(part, sorted(known)),
                )
        if topic in found:
            raise UsageError(f"--as names {topic} twice")
        found[topic] = unit
    return found


def is_lever_arm_on_car(ahead_m: float, left_m: float) -> bool:
    """Whether a lever arm (m) lies within the accepted bounds; False for NaN."""
    return abs(ahead_m) <= MAX_LONGITUDINAL_LEVER_ARM_M and abs(left_m) <= MAX_LATERAL_LEVER_ARM_M


@dataclass(frozen=True)
class EstimatorConfig:
    """Settings of `estimate_track`.

    Attributes:
        model: "cwcli" (eight states, asynchronous sensors, biases) or "song2016" (the paper's six states and
            synchronous measurement vector, eq. 1-8).
        causal: The filter alone, without the smoother: an estimate uses nothing that was measured later.
        latency: "auto" finds each source's latency from the log; "none" trusts the stamps; a mapping from
            source (or "source:kind", e.g. "/gps/vel:velocity") to seconds fixes those and finds the others.
            Positive means late: true time = stamp - latency.
        sensor_model: "auto" looks for slow errors of the fixes, gravity through the road's grade, and scale and lever
            arm of a speed, and uses those that predict the log better; "none" models biases and white noise only.
        lever_arms: Source -> lever arm, m ahead and to the left of the reference point, whose course is the heading
            (about the middle of the rear axle); the published states are then of that point.
        sigmas: Role or topic -> noise where the messages state none, see `stated_noise`.
        gate_probability: Probability with which the gate keeps a measurement that fits the model; 1 = off.
        reset_after: Consecutive rejections of one source after which its next measurement is used.
        calibration: Constants of the sensors from earlier drives. With `causal` they are used unchanged, and nothing
            that the log would only show later; else they are weighed with what the log shows.
        blind: With `causal`: no parameter is looked for in the log. Those of the calibration are used; without one the
            stamps, the noise that the messages state and the defaults.
        compares_sources: Compare the sources with each other: contradictions are reported, and an outvoted source is
            left out.
        trusted_sources: Sources that are neither corrected nor left out.
        source_units: Source -> name of the unit or convention that its values have, see
            `hypotheses.UNIT_AND_CONVENTION_HYPOTHESES_BY_KIND`.
        senders: How senders of BSMs filtered their motion before they sent it: "plain" not at all, "j2945" as SAE
            J2945/1 asks (`signals.bsm_sender`); the filter is inverted.
        rate_hz: Grid of the output when `estimate_track` gets no output stamps.
        song2016_step_s: Sampling time of the six-state filter (dT of eq. 2).
    """

    model: Annotated[
        ModelName,
        Option("--model", "cwcli: eight states, each sensor at its own time; song2016: the paper's six-state filter."),
    ] = "cwcli"
    causal: Annotated[bool, Option("--causal", "Do not smooth: the channels in hindsight get the online states.")] = (
        False
    )
    latency: Annotated[
        LatencyOption,
        Option(
            "--latency",
            "auto: find each source's latency from the log; none: trust the stamps; NAME=MS: this topic's latency "
            "in milliseconds, positive is late (the others are found). Repeatable.",
            metavar="auto|none|NAME=MS",
            default="auto",
            kind=list[str],
            parse=parse_latency_option,
        ),
    ] = "auto"
    sensor_model: Annotated[
        SensorModelOption,
        Option(
            "--sensor-model",
            "auto: find slow errors, scales and lever arms from the log, and use those that predict better; none: "
            "use biases and white noise alone.",
        ),
    ] = "auto"
    lever_arms: Annotated[
        LeverArms,
        Option(
            "--lever-arm",
            "Position of a topic's sensor, in metres ahead of and to the left of the middle of the rear axle, "
            "which is then the point of the states. Without it, the log's transforms are used. Repeatable.",
            metavar="NAME=AHEAD,LEFT",
            kind=list[str],
            parse=parse_lever_arm_options,
        ),
    ] = field(default_factory=dict)
    sigmas: Annotated[
        SigmasByRoleOrTopic,
        Option(
            "--sigma",
            "Noise (1 sigma) of a sensor whose messages state none, in m, m/s or rad, or in degrees with deg, by "
            "role or topic: ego_speed=0.5, ego_heading=1deg, imu=0.05/0.1deg. Without it, the noise is found "
            "from the log. Repeatable.",
            metavar="NAME=VALUE",
            kind=list[str],
            parse=parse_sigmas_by_role_or_topic,
        ),
    ] = field(default_factory=dict)
    gate_probability: Annotated[
        float,
        Option(
            "--gate",
            "Probability that a good measurement passes the gate; 1 turns the gate off.",
            metavar="P",
            above=0.0,
            at_most=1.0,
        ),
    ] = 0.999
    reset_after: int = 20
    calibration: Calibration | None = None
    blind: bool = False
    compares_sources: bool = True
    trusted_sources: Annotated[
        tuple[str, ...],
        Option(
            "--trust",
            "Never correct or leave out this topic, even if other sensors contradict it. Repeatable.",
            metavar="TOPIC",
            kind=list[str],
            parse=tuple,
        ),
    ] = ()
    source_units: Annotated[
        Mapping[str, str],
        Option(
            "--as",
            "State the unit, sign, axes or convention of a topic's values, without a check against the log: "
            "/vehicle/velocity=km/h, /imu/data=degrees/s+-y,x,z, /heading=clockwise-from-north. Repeatable.",
            metavar="TOPIC=UNIT",
            kind=list[str],
            parse=parse_source_units,
        ),
    ] = field(default_factory=dict)
    senders: Annotated[
        Senders,
        Option(
            "--senders",
            "plain: BSMs hold the senders' motion as it is; j2945: the senders filter the acceleration at 1 Hz "
            "and hold the heading at standstill (SAE J2945/1), and cwcli undoes both.",
        ),
    ] = "plain"
    rate_hz: float = 20.0
    song2016_step_s: float = 0.05

    @property
    def sources_with_trusted_clock(self) -> tuple[str, ...]:
        """Sources whose stamps stay as they are, because the user gives their latency or trusts them."""
        sources_of_latencies = (
            () if isinstance(self.latency, str) else tuple(name.partition(":")[0] for name in self.latency)
        )
        return (*sources_of_latencies, *self.trusted_sources)

    @property
    def takes_no_online_parameter_from_log(self) -> bool:
        """Whether online states take no parameter from the log, due to a calibration or to `latency` being "none"."""
        return self.calibration is not None or self.latency == "none"
