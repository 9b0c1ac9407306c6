"""The table of stages: what every line of it must be, so that commands, docs and runs can be made from it."""

from __future__ import annotations

import dataclasses
import pickle

import pytest

from cwcli.channels.binding import ALL_ROLE_NAMES
from cwcli.channels.published import PUBLISHED_CHANNELS
from cwcli.errors import UsageError
from cwcli.pipeline.call import StageCall
from cwcli.pipeline.stage import Stage
from cwcli.stages import DEFAULT_STAGES, STAGES

ALL = pytest.mark.parametrize("stage", STAGES.values(), ids=STAGES)


@ALL
def test_a_line_leads_to_function_configuration_and_examples(stage: Stage) -> None:
    assert callable(stage.stage_function)
    assert dataclasses.is_dataclass(stage.configuration_class())
    assert any(f"cwcli {stage.name} " in example for example in stage.imported_module.EXAMPLES)
    assert stage.help.endswith(".") and len(stage.help) < 66


@ALL
def test_its_roles_are_roles(stage: Stage) -> None:
    named = {role for group in stage.required_role_groups for role in group}
    assert {*named, *stage.used, *stage.input_role_by_added_role, *stage.input_role_by_added_role.values()} <= set(
        ALL_ROLE_NAMES
    )


def test_a_channel_is_made_from_an_input_of_its_stage() -> None:
    added = {
        "ego_state": "ego_position",
        "remote_state": "remote",
        "ego_online": "ego_position",
        "remote_online": "remote",
        "remote_events": "remote",
    }
    assert STAGES["estimate"].input_role_by_added_role.items() >= added.items()  # a new channel adds its own
    for channel in PUBLISHED_CHANNELS:
        stage = STAGES[channel.stage]
        taken = {role for group in stage.required_role_groups for role in group} | set(stage.used)
        assert channel.source in taken if channel.role else not channel.source


@ALL
def test_other_stages_that_it_names_are_there(stage: Stage) -> None:
    assert {stage.instead_of, *stage.first} - {""} <= set(STAGES)


@ALL
def test_its_call_can_be_sent_to_another_process(stage: Stage) -> None:
    call = StageCall(stage, stage.configuration_class())
    assert pickle.loads(pickle.dumps(call)) == call


def test_published_channels_name_stages() -> None:
    assert {channel.stage for channel in PUBLISHED_CHANNELS} <= set(STAGES)


def test_a_run_looks_at_a_drive_and_no_more_unless_it_is_asked() -> None:
    assert DEFAULT_STAGES == ("estimate", "track", "lanes", "observe", "predict", "warn")


def test_a_line_whose_module_is_missing_says_so() -> None:
    with pytest.raises(UsageError, match=r"the stage no-such can't be loaded.*cwcli.stages.no_such") as caught:
        Stage("no-such", "None.").configuration_class  # noqa: B018 - imports it
    assert (caught.value.exit_code, caught.value.hint) == (2, "install cwcli again")
