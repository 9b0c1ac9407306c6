"""zhang2011, sections 2.2 and 3.2: f(v), the gains, and the worked example at 88 km/h; tables 1 to 5 and figure 13.

The paper counts v_y, gamma and delta positive to the right, so its example is a steering angle of -0.05 rad here; all
numbers are turned back into its signs.

How the example's print is read. The printed gains have no rows for v_y and gamma, so in those two states the printed
observers are the models of 80 and 90 km/h, driven by the angle alone. Their printed values are those models 2.0 s after
the angle is applied from straight running: 20 frames, the length of a track. The vector printed as the car's state is,
to its last digit, the blend (eq. 22) of the two printed observers, and the one printed as observed holds the v_y and
gamma of the car at 2.0 s: the two are exchanged.
"""

from __future__ import annotations

import numpy as np

from cwcli.dynamics.blended import observer_bank
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.matrix_exponential import discretise
from cwcli.dynamics.single_track import preview_matrices, understeer_gradient
from cwcli.dynamics.steering import correction
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.reproduction.classes import Measured
from cwcli.reproduction.findings import Curve, Part, Plot
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import MPS_PER_KMH
from cwcli.vision import zhang2011 as lanes
from cwcli.vision.objective import WEIGHTS

STEER_RAD = -0.05
"""Steering angle of the paper's worked example, in our sign, in rad (section 3.2)."""
CURVATURE_1PM = 0.001
"""Curvature of the lane in the paper's worked example, in 1/m (section 3.2)."""
PERIOD_S = 0.1
"""Time between frames, in s: the paper's 10 Hz."""
FRAMES = 20
"""Frames after which the printed states were taken: 2.0 s, the length of a track; see the module."""
CAR_KMH = 88.0
"""Speed of the car in the worked example, in km/h (section 3.2)."""
OBSERVERS_KMH = (80.0, 90.0)
"""Speeds of the two observers in the worked example, in km/h (section 3.2)."""
SIGNS = np.array([-1.0, -1.0, 1.0, 1.0])
"""Factors from our signs of v_y, gamma, y_L and e_L to the paper's."""
STATES = ("v_y", "gamma", "y_L", "e_L")
"""Names of the four states, in order."""
PRINTED = {80.0: (-1.417, 0.4008, -3.498, -0.0582), 90.0: (-1.996, 0.418, -3.524, -0.0658)}
"""Speed in km/h -> the printed state of its observer, with the labels 80 and 90 exchanged back."""
PHASES = {"frame 1": lanes.FIRST, "frames 2-6": lanes.SECOND, "later": lanes.THIRD}
"""Name -> the search phase of the lane method."""


def tables_part() -> Part:
    """Compute tables 1 to 5 and the worked examples of section 1.2.2 from the code."""
    measured = [
        Measured(
            "table 1",
            "entries of the code that are the printed ones",
            _n_equal(WEIGHTS[0] + WEIGHTS[1] + WEIGHTS[2], (4, 6, 0, 2, 5, 3, 2, 5, 3)),
        ),
        Measured(
            "table 2",
            "entries of the code that are the printed ones",
            _n_equal(WEIGHTS[0] + WEIGHTS[1] + WEIGHTS[2], (4, 6, 0, 2, 5, 3, 2, 5, 3)),
        ),
    ]
    reaches = {"frame 1": (0.005, 1.0, 125.0), "frames 2-6": lanes.SECOND.reach, "later": lanes.THIRD.reach}
    for name, phase in PHASES.items():
        reach = reaches[name]
        assert reach is not None
        bits = [lanes.n_bits(-half, half, m) for half, m in zip(reach, lanes.DECIMALS, strict=True)]
        for letter, count in zip("abc", bits, strict=True):
            measured.append(Measured("table 3", f"{name}: bits of {letter} by eq. 4", float(count)))
        measured.append(Measured("table 3", f"{name}: length of the chromosome", float(sum(bits))))
        measured.append(Measured("table 4", f"{name}: generations", float(phase.generations)))
    car = load_vehicle()
    values = {
        "L": car.wheelbase_m,
        "l_f": car.front_axle_m,
        "l_r": car.rear_axle_m,
        "m_1": car.loaded("empty").mass_kg,
        "m": car.loaded("full").mass_kg,
        "k_f": car.front_stiffness_nprad,
        "k_r": car.rear_stiffness_nprad,
        "I_zz": car.yaw_inertia_kgm2,
    }
    measured += [Measured("table 5", name, float(value)) for name, value in values.items()]
    region = np.array(lanes.FIRST_LEFT)
    decoded = lanes.decode("01010100011100001011101", region[:, 0].copy(), region[:, 1].copy(), lanes.FIRST.bits)
    measured += [
        Measured("eq 5", f"worked example: {letter}", value) for letter, value in zip("abc", decoded, strict=True)
    ]
    crossed = lanes.crossover("10101001010001011010", "10110001001101111100", (4, 13, 18))
    is_crossed = crossed == ("10100001001101011000", "10111001010001111110")
    measured.append(
        Measured("eq 5", "worked example: both children of the crossover are the printed ones", float(is_crossed))
    )
    is_mutated = lanes.mutate("011001000100110", 9) == "011001000000110"
    measured.append(Measured("eq 5", "worked example: the mutated string is the printed one", float(is_mutated)))
    return Part(tuple(measured))


def example_part() -> Part:
    """Compute f(v), figure 13, the printed gains, and the worked example of section 3.2."""
    car = load_vehicle()
    measured = [
        Measured("eq 13", "f(v) - 1 over v^2, half load", understeer_gradient(car) / car.wheelbase_m),
        *_gains(),
        *_blend(),
        *_models(),
        *_real_observers(),
    ]
    kmh = np.linspace(0.0, 160.0, 81)
    factor = np.array([float(correction(car, v)) for v in kmh * MPS_PER_KMH])
    plot = Plot(
        "fig 13", "correction f of the steering angle, half load", "speed [km/h]", "f", [Curve("f(v)", kmh, factor)]
    )
    return Part(tuple(measured), (plot,))


def _n_equal(ours: tuple[int, ...], printed: tuple[int, ...]) -> float:
    """Count the entries that are the printed ones."""
    return float(sum(a == b for a, b in zip(ours, printed, strict=True)))


def _gains() -> list[Measured]:
    """Return the gains at rest of eq. 17, in the paper's signs."""
    bank = observer_bank(load_vehicle(), ObserverConfig("zhang2011"), PERIOD_S)
    return [
        Measured(
            "eq 17", f"K_{kmh:.0f}: {state} from {source}", float(SIGNS[row] * bank.gain[_index(kmh), row, column])
        )
        for kmh in OBSERVERS_KMH
        for row, state in enumerate(STATES)
        for column, source in enumerate(("y_L", "e_L"))
    ]


def _index(kmh: float) -> int:
    """Return the index of a speed in the bank of observers, which has one per 10 km/h."""
    return round(kmh / 10.0) - 1


def _blend() -> list[Measured]:
    """Return the blend (eq. 22) of the printed observers."""
    blended = 0.2 * np.array(PRINTED[80.0]) + 0.8 * np.array(PRINTED[90.0])
    return [
        Measured("eq 22", f"blend of the two printed observers: {state}", float(value))
        for state, value in zip(STATES, blended, strict=True)
    ]


def _models() -> list[Measured]:
    """Return the states of the models of 80, 90 and 88 km/h, 2 s after the angle is applied from straight running."""
    measured = []
    for kmh, whose in ((80.0, "model of 80 km/h"), (90.0, "model of 90 km/h"), (CAR_KMH, "car at 88 km/h")):
        state = SIGNS * driven(kmh)[-1]
        n_states = len(STATES) if kmh == CAR_KMH else 2
        measured += [Measured("eq 22", f"{whose}: {STATES[k]}", float(state[k])) for k in range(n_states)]
    return measured


def driven(kmh: float) -> FloatArray:
    """Simulate the linear model from straight running under the example's angle, shape (21, 4), our signs."""
    phi, gamma = discretise(*preview_matrices(load_vehicle(), kmh * MPS_PER_KMH, ObserverConfig().preview_m), PERIOD_S)
    states = np.zeros((FRAMES + 1, 4))
    for k in range(FRAMES):
        states[k + 1] = phi @ states[k] + gamma @ (STEER_RAD, CURVATURE_1PM)
    return states


def _real_observers() -> list[Measured]:
    """Return the states of both observers, with the gains of eq. 17, on the car at 88 km/h, and their blend."""
    bank = observer_bank(load_vehicle(), ObserverConfig("zhang2011"), PERIOD_S)
    actual = driven(CAR_KMH)
    found = {}
    for kmh in OBSERVERS_KMH:
        at, state = _index(kmh), np.zeros(4)
        for true in actual[1:]:
            state = bank.phi[at] @ state + bank.gamma[at] @ (STEER_RAD, CURVATURE_1PM)
            state = state + bank.gain[at] @ (true[2:] - state[2:])
        found[f"observer of {kmh:.0f} km/h at 88 km/h"] = SIGNS * state
    found["blend of both observers at 88 km/h"] = (
        0.2 * found["observer of 80 km/h at 88 km/h"] + 0.8 * found["observer of 90 km/h at 88 km/h"]
    )
    return [
        Measured("eq 22", f"{whose}: {name}", float(state[k]))
        for whose, state in found.items()
        for k, name in enumerate(STATES)
    ]
