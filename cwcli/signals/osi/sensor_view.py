"""`osi3.SensorView`: the GroundTruth that a sensor is given; its host vehicle is the one that carries the sensor."""

from __future__ import annotations

from functools import partial

from cwcli.signals.osi import roles
from cwcli.signals.osi.leaves import SENSOR_VIEW_PREFIX

build_pose = partial(roles.build_pose, prefix=SENSOR_VIEW_PREFIX)
build_speed = partial(roles.build_speed, prefix=SENSOR_VIEW_PREFIX)
build_remote = partial(roles.build_remote, prefix=SENSOR_VIEW_PREFIX)
build_target_truth = partial(roles.build_target_truth, prefix=SENSOR_VIEW_PREFIX)
