"""Knowledge behind the states that a metric compares: online, in hindsight, or a truth."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.channels.published import EGO_STATE, OWN_PREFIX
from cwcli.pipeline.records import Record, configuration_of, inputs_of

ONLINE, HINDSIGHT, TRUTH, SYSTEM = "online", "hindsight", "truth", "system"
"""Names of the knowledge behind states, as the table `metrics` has them."""
STATE_ROLES = ("ego_state", "remote_state", "targets")
"""Roles of inputs that are states."""


def against(states: str, reference: str) -> str:
    """Return the label of a comparison, such as `online vs truth`."""
    return f"{states} vs {reference}"


def estimated(records: Mapping[str, Record]) -> str:
    """Return the knowledge behind the states of `/cwcli/ego/state`: online after a causal run, else hindsight."""
    return knowledge_of(records.get("estimate", {}))


def knowledge_of(record: Record) -> str:
    """Return the knowledge behind the states that a stage wrote: online with `--causal`, else hindsight."""
    configuration = configuration_of(record)
    parts = (configuration, *configuration.values())
    return ONLINE if any(isinstance(part, dict) and part.get("causal") is True for part in parts) else HINDSIGHT


def read_by(records: Mapping[str, Record], record: Record) -> str:
    """Return the knowledge behind the states that a stage read, by the topics in its record."""
    topics = {str(entry.get("topic")) for entry in inputs_of(record) if entry.get("role") in STATE_ROLES}
    own = {topic for topic in topics if topic.startswith(OWN_PREFIX)} or {EGO_STATE.topic}
    return ONLINE if all(topic.endswith("/online") for topic in own) else estimated(records)
