"""`osi3.SensorView`: the GroundTruth that a sensor is given; its host vehicle is the one that carries the sensor."""

from __future__ import annotations

from functools import partial

from cwcli.signals.osi import roles
from cwcli.signals.osi.leaves import WORLD

build_pose = partial(roles.build_pose, prefix=WORLD)
build_speed = partial(roles.build_speed, prefix=WORLD)
build_remote = partial(roles.build_remote, prefix=WORLD)
build_target_truth = partial(roles.build_target_truth, prefix=WORLD)
