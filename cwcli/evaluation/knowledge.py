"""Knowledge behind the states that a metric compares: online, in hindsight, or a truth."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.channels.published import EGO_STATE, OWN_TOPIC_PREFIX
from cwcli.pipeline.records import Record, read_configuration, read_input_counts

ONLINE, HINDSIGHT, TRUTH, OTHER_SYSTEM = "online", "hindsight", "truth", "system"
"""Names of the knowledge behind states, as the table `metrics` has them."""
ROLES_OF_STATES = ("ego_state", "remote_state", "targets")
"""Roles of inputs that are states."""


def comparison_label(states: str, reference: str) -> str:
    """Return the label of a comparison, such as `online vs truth`."""
    return f"{states} vs {reference}"


def online_or_hindsight_of_ego_states(records: Mapping[str, Record]) -> str:
    """Return the knowledge behind the states of `/cwcli/ego/state`: online after a causal run, else hindsight."""
    return online_or_hindsight_of_stage_output(records.get("estimate", {}))


def online_or_hindsight_of_stage_output(record: Record) -> str:
    """Return the knowledge behind the states that a stage wrote: online with `--causal`, else hindsight."""
    configuration = read_configuration(record)
    parts = (configuration, *configuration.values())
    return ONLINE if any(isinstance(part, dict) and part.get("causal") is True for part in parts) else HINDSIGHT


def online_or_hindsight_of_stage_input(records: Mapping[str, Record], record: Record) -> str:
    """Return the knowledge behind the states that a stage read, by the topics in its record."""
    topics = {str(entry.get("topic")) for entry in read_input_counts(record) if entry.get("role") in ROLES_OF_STATES}
    own = {topic for topic in topics if topic.startswith(OWN_TOPIC_PREFIX)} or {EGO_STATE.topic}
    return ONLINE if all(topic.endswith("/online") for topic in own) else online_or_hindsight_of_ego_states(records)
