"""Which states of knowledge a metric is made of: what could have been known, or what is known in hindsight."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.channels.published import EGO_STATE, OWN_PREFIX
from cwcli.pipeline.records import Record, configuration_of, inputs_of

ONLINE, HINDSIGHT, TRUTH, SYSTEM = "online", "hindsight", "truth", "system"
STATE_ROLES = ("ego_state", "remote_state", "targets")


def against(states: str, reference: str) -> str:
    """`online vs truth`."""
    return f"{states} vs {reference}"


def estimated(records: Mapping[str, Record]) -> str:
    """What the states of `/cwcli/ego/state` know: those of a causal run nothing that came later."""
    return knowledge_of(records.get("estimate", {}))


def knowledge_of(record: Record) -> str:
    """What the states know that a stage has made: with `--causal` nothing that came later."""
    configuration = configuration_of(record)
    parts = (configuration, *configuration.values())
    return ONLINE if any(isinstance(part, dict) and part.get("causal") is True for part in parts) else HINDSIGHT


def read_by(records: Mapping[str, Record], record: Record) -> str:
    """What the states know that a stage has read, by the topics in its record."""
    topics = {str(entry.get("topic")) for entry in inputs_of(record) if entry.get("role") in STATE_ROLES}
    own = {topic for topic in topics if topic.startswith(OWN_PREFIX)} or {EGO_STATE.topic}
    return ONLINE if all(topic.endswith("/online") for topic in own) else estimated(records)
