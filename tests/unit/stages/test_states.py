"""Which states a stage reads: the online ones, those in hindsight, or the only ones that there are, with a note."""

from __future__ import annotations

import json

import pytest

from cwcli.channels.binding import bind_roles
from cwcli.channels.published import EGO_ONLINE, EGO_STATE, REMOTE_ONLINE, REMOTE_STATE, Channel
from cwcli.errors import MissingSignalError
from cwcli.pipeline.states import States, StatesSelection, bind_state_channels, note_if_paths_start_from_other_states
from tests.unit.channels.test_binding import Channel as LogChannel

ROLES = (EGO_STATE.role, REMOTE_STATE.role)


def log(*published: Channel) -> list[LogChannel]:
    return [LogChannel(each.topic, each.schema, "protobuf") for each in published]


BOTH = log(EGO_STATE, EGO_ONLINE, REMOTE_STATE, REMOTE_ONLINE)
OLD = log(EGO_STATE, REMOTE_STATE)


@pytest.mark.parametrize(
    ("channels", "states", "ego", "words"),
    [
        (BOTH, "online", EGO_ONLINE, ""),
        (BOTH, "hindsight", EGO_STATE, "--states hindsight"),
        (OLD, "online", EGO_STATE, "no online states"),
        (log(EGO_ONLINE, REMOTE_ONLINE), "online", EGO_ONLINE, ""),
        (log(EGO_ONLINE, REMOTE_ONLINE), "hindsight", EGO_ONLINE, "in hindsight: /cwcli/ego/online is used"),
    ],
)
def test_the_states_that_were_asked_for_are_read(
    channels: list[LogChannel], states: States, ego: Channel, words: str
) -> None:
    bound = bind_state_channels(channels, StatesSelection(states=states), required=ROLES)
    assert bound.first_topic_of_role(EGO_STATE.role) == ego.topic
    assert any(words in note for note in bound.notes) if words else not bound.notes


def test_what_the_user_names_counts() -> None:
    channels = [*BOTH, LogChannel("/other/state", EGO_STATE.schema, "protobuf")]
    for name in (EGO_STATE.role, EGO_ONLINE.role):
        bound = bind_state_channels(channels, StatesSelection(topics={name: "/other/state"}), required=ROLES)
        assert bound.first_topic_of_role(EGO_STATE.role) == "/other/state"
        assert bound.first_topic_of_role(REMOTE_STATE.role) == REMOTE_ONLINE.topic


def test_whoever_judges_gets_the_states_in_hindsight() -> None:
    assert bind_roles(BOTH, {}, required=ROLES).first_topic_of_role(EGO_STATE.role) == EGO_STATE.topic


def test_without_any_states_the_hint_names_the_command() -> None:
    with pytest.raises(MissingSignalError) as caught:
        bind_state_channels([], StatesSelection(), required=ROLES, command="predict")
    assert "cwcli estimate" in caught.value.hint


def test_paths_of_other_states_than_those_that_are_read_are_noted() -> None:
    def record(**used: str) -> dict[str, str]:
        return {"configuration": json.dumps(used)}

    assert note_if_paths_start_from_other_states(StatesSelection(), record(states="online")) == ()
    assert note_if_paths_start_from_other_states(StatesSelection(), {}) == ()
    for of_paths in (record(states="hindsight"), record()):  # an older version knew no others
        assert any(
            "--states hindsight" in note for note in note_if_paths_start_from_other_states(StatesSelection(), of_paths)
        )
