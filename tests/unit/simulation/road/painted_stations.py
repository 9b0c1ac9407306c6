"""Where a marking of the simulated road is painted."""

import math

import numpy as np

from cwcli.signals.columns import BoolArray, FloatArray
from cwcli.simulation.road.scene import Marking, RoadScene


def painted_station_mask(scene: RoadScene, marking: Marking, station_m: FloatArray) -> BoolArray:
    """Mask of stations (n,) at which a marking, or a dividing line in its place, is painted; dashes' gaps count."""
    is_painted = np.zeros(np.shape(station_m), np.bool_)
    for each in (marking, *scene.others):
        if each.offset_m == marking.offset_m and not each.path_m:
            for low_m, high_m in each.painted_stretches_m or ((-math.inf, math.inf),):
                is_painted |= (station_m >= low_m) & (station_m <= high_m)
    return is_painted
