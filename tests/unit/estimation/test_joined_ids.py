"""Remote vehicles that change their ids: joined only when asked for, and told."""

from __future__ import annotations

import numpy as np

from cwcli.estimation.from_signals import merge_remotes_placed_in_map_and_note
from tests.unit.signals.pseudonyms import HERE, scene


def test_ids_are_joined_when_asked_for_and_the_notes_tell_which() -> None:
    made = scene(np.random.default_rng(1), n_cars=1)
    ((first, second),) = made.ids
    apart, notes = merge_remotes_placed_in_map_and_note([made.signal], made.signal, HERE)
    assert apart is not None
    assert apart.station.values == (first, second)
    assert notes == ()
    joined, notes = merge_remotes_placed_in_map_and_note([made.signal], made.signal, HERE, is_stitched=True)
    assert joined is not None
    assert joined.station.values == (first,)
    assert notes == (f"changed ids joined by motion: 1 ({first} became {second})",)
