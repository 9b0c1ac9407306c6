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

import math

import numpy as np

from cwcli.dynamics.blended import OBSERVER_OUTPUT_MATRIX, design_observer_bank
from cwcli.dynamics.config import ObserverConfig
from cwcli.dynamics.matrix_exponential import transition_and_input_matrices
from cwcli.dynamics.riccati import steady_predicted_covariance
from cwcli.dynamics.single_track import preview_state_matrices, understeer_gradient_rad_per_mps2
from cwcli.dynamics.steering import dynamic_to_kinematic_steering_ratio
from cwcli.dynamics.vehicle import load_vehicle
from cwcli.reproduction.classes import MeasuredNumber
from cwcli.reproduction.expectations import printed_number_or_nan
from cwcli.reproduction.findings import Curve, Plot, StudyPart
from cwcli.signals.columns import FloatArray
from cwcli.signals.units import MPS_PER_KMH
from cwcli.vision import zhang2011 as lanes
from cwcli.vision.objective import BLOCK_WEIGHTS_TENTHS

EXAMPLE_STEER_RAD = -0.05
"""Steering angle of the paper's worked example, in our sign, in rad (section 3.2)."""
EXAMPLE_CURVATURE_1PM = 0.001
"""Curvature of the lane in the paper's worked example, in 1/m (section 3.2)."""
FRAME_PERIOD_S = 0.1
"""Time between frames, in s: the paper's 10 Hz."""
N_EXAMPLE_FRAMES = 20
"""Frames after which the printed states were taken: 2.0 s, the length of a track; see the module."""
CAR_SPEED_KMH = 88.0
"""Speed of the car in the worked example, in km/h (section 3.2)."""
OBSERVER_SPEEDS_KMH = (80.0, 90.0)
"""Speeds of the two observers in the worked example, in km/h (section 3.2)."""
SIGN_FACTORS_TO_PAPER_STATE = np.array([-1.0, -1.0, 1.0, 1.0])
"""Factors from our signs of v_y, gamma, y_L and e_L to the paper's."""
FIGURE_AND_NAME_OF_STEERING_CORRECTION = ("eq 13", "f(v) - 1 over v^2, half load")
"""Figure and name of the factor of the speed's square in the correction of the steering angle."""
STATE_NAMES = ("v_y", "gamma", "y_L", "e_L")
"""Names of the four states, in order."""
PRINTED_STATE_BY_OBSERVER_SPEED_KMH = {80.0: (-1.417, 0.4008, -3.498, -0.0582), 90.0: (-1.996, 0.418, -3.524, -0.0658)}
"""Speed in km/h -> the printed state of its observer, with the labels 80 and 90 exchanged back."""
PRINTED_GAIN_BY_OBSERVER_SPEED_KMH = {
    80.0: ((0.534, 2.722), (-0.442, 1.478)),
    90.0: ((0.444, 3.245), (-0.467, 1.63)),
}
"""Speed in km/h -> the printed rows of y_L and e_L of its gain (section 3.2)."""
SEARCH_PHASE_BY_NAME = {"frame 1": lanes.FIRST_PHASE, "frames 2-6": lanes.SECOND_PHASE, "later": lanes.LATER_PHASE}
"""Name -> the search phase of the lane method."""


def printed_tables_part() -> StudyPart:
    """Compute tables 1 to 5 and the worked examples of section 1.2.2 from the code."""
    measured = [
        MeasuredNumber(
            "table 1",
            "entries of the code that are the printed ones",
            _count_equal_entries(
                BLOCK_WEIGHTS_TENTHS[0] + BLOCK_WEIGHTS_TENTHS[1] + BLOCK_WEIGHTS_TENTHS[2], (4, 6, 0, 2, 5, 3, 2, 5, 3)
            ),
        ),
        MeasuredNumber(
            "table 2",
            "entries of the code that are the printed ones",
            _count_equal_entries(
                BLOCK_WEIGHTS_TENTHS[0] + BLOCK_WEIGHTS_TENTHS[1] + BLOCK_WEIGHTS_TENTHS[2], (4, 6, 0, 2, 5, 3, 2, 5, 3)
            ),
        ),
    ]
    reaches = {
        "frame 1": (0.005, 1.0, 125.0),
        "frames 2-6": lanes.SECOND_PHASE.region_half_widths,
        "later": lanes.LATER_PHASE.region_half_widths,
    }
    for name, phase in SEARCH_PHASE_BY_NAME.items():
        reach = reaches[name]
        assert reach is not None
        bits = [
            lanes.count_parameter_bits(-half, half, m) for half, m in zip(reach, lanes.PARAMETER_DECIMALS, strict=True)
        ]
        for letter, count in zip("abc", bits, strict=True):
            measured.append(MeasuredNumber("table 3", f"{name}: bits of {letter} by eq. 4", float(count)))
        measured.append(MeasuredNumber("table 3", f"{name}: length of the chromosome", float(sum(bits))))
        measured.append(MeasuredNumber("table 4", f"{name}: generations", float(phase.generations)))
    car = load_vehicle()
    values = {
        "L": car.wheelbase_m,
        "l_f": car.front_axle_m,
        "l_r": car.rear_axle_m,
        "m_1": car.with_load("empty").mass_kg,
        "m": car.with_load("full").mass_kg,
        "k_f": car.front_stiffness_nprad,
        "k_r": car.rear_stiffness_nprad,
        "I_zz": car.yaw_inertia_kgm2,
    }
    measured += [MeasuredNumber("table 5", name, float(value)) for name, value in values.items()]
    region = np.array(lanes.FIRST_SEARCH_RANGES_OF_LEFT_BOUNDARY)
    decoded = lanes.decode_chromosome_to_a_b_c(
        "01010100011100001011101", region[:, 0].copy(), region[:, 1].copy(), lanes.FIRST_PHASE.bits
    )
    measured += [
        MeasuredNumber("eq 5", f"worked example: {letter}", value) for letter, value in zip("abc", decoded, strict=True)
    ]
    crossed = lanes.cross_chromosomes("10101001010001011010", "10110001001101111100", (4, 13, 18))
    measured += [
        MeasuredNumber("eq 5", f"worked example: {which} child of the crossover", math.nan, text=child)
        for which, child in zip(("first", "second"), crossed, strict=True)
    ]
    mutated = lanes.mutate_chromosome("011001000100110", 9)
    measured.append(MeasuredNumber("eq 5", "worked example: the mutated string", math.nan, text=mutated))
    return StudyPart(tuple(measured))


def worked_example_part() -> StudyPart:
    """Compute f(v), figure 13, the printed gains, and the worked example of section 3.2."""
    car = load_vehicle()
    measured = [
        MeasuredNumber(
            *FIGURE_AND_NAME_OF_STEERING_CORRECTION, understeer_gradient_rad_per_mps2(car) / car.wheelbase_m
        ),
        *_observer_gain_numbers(),
        *_blended_print_numbers(),
        *_model_state_numbers(),
        *_observer_state_numbers(),
    ]
    kmh = np.linspace(0.0, 160.0, 81)
    factor = np.array([float(dynamic_to_kinematic_steering_ratio(car, v)) for v in kmh * MPS_PER_KMH])
    printed_kmh = np.arange(0.0, 161.0, 10.0)
    printed = (
        1.0
        + printed_number_or_nan("zhang2011", *FIGURE_AND_NAME_OF_STEERING_CORRECTION) * (printed_kmh * MPS_PER_KMH) ** 2
    )
    curves = [
        Curve("f(v)", kmh, factor),
        Curve("printed: 1 + 0.000843 v^2", printed_kmh, printed, is_points=True),
    ]
    plot = Plot("fig 13", "correction f of the steering angle, half load", "speed [km/h]", "f", curves)
    return StudyPart(tuple(measured), (plot,))


def _count_equal_entries(ours: tuple[int, ...], printed: tuple[int, ...]) -> float:
    """Count the entries that are the printed ones."""
    return float(sum(a == b for a, b in zip(ours, printed, strict=True)))


def _observer_gain_numbers() -> list[MeasuredNumber]:
    """Return the gains at rest of eq. 17, in the paper's signs, with two readings of R1; and the poles."""
    bank = design_observer_bank(load_vehicle(), ObserverConfig("zhang2011"), FRAME_PERIOD_S)
    measured, poles = [], []
    for kmh in OBSERVER_SPEEDS_KMH:
        readings = {
            "": filter_gain_with_curvature_noise(kmh),
            ", R1 on all states": bank.gain[_bank_index_of_speed(kmh)],
        }
        measured += [
            MeasuredNumber(
                "eq 17",
                f"K_{kmh:.0f}: {state} from {source}{reading}",
                float(SIGN_FACTORS_TO_PAPER_STATE[row] * gain[row, column]) + 0.0,  # no negative zero
            )
            for reading, gain in readings.items()
            for row, state in enumerate(STATE_NAMES)
            for column, source in enumerate(("y_L", "e_L"))
        ]
        for label, gain in {
            "printed": np.array(PRINTED_GAIN_BY_OBSERVER_SPEED_KMH[kmh]),
            "with R1 on the curvature": next_state_predictor_gain(kmh)[2:],
        }.items():
            of_lane = lane_state_transition_matrix(kmh) - gain
            poles.append(
                MeasuredNumber(
                    "eq 17",
                    f"{kmh:.0f} km/h: largest pole of the predictor of y_L and e_L, gain {label}",
                    float(np.abs(np.linalg.eigvals(of_lane)).max()),
                )
            )
    return measured + poles


def filter_gain_with_curvature_noise(kmh: float) -> FloatArray:
    """Return the filter's gain (4, 2) at rest with R1 as one number, the variance of the curvature input alone.

    The car's states v_y and gamma do not depend on the curvature and are stable, so their rows are exactly zero.
    """
    predicted = _predicted_covariance_with_curvature_noise(kmh)
    innovation = OBSERVER_OUTPUT_MATRIX @ predicted @ OBSERVER_OUTPUT_MATRIX.T + _lane_noise_covariance()
    return np.asarray(np.linalg.solve(innovation, OBSERVER_OUTPUT_MATRIX @ predicted).T)


def next_state_predictor_gain(kmh: float) -> FloatArray:
    """Return the gain (4, 2) of the predictor of the next state, Phi K, for `filter_gain_with_curvature_noise`."""
    phi, _ = _example_transition_and_input(kmh)
    return np.asarray(phi @ filter_gain_with_curvature_noise(kmh))


def lane_state_transition_matrix(kmh: float) -> FloatArray:
    """Return the part (2, 2) of the transition matrix that leads from y_L and e_L to themselves."""
    return np.asarray(_example_transition_and_input(kmh)[0][2:, 2:])


def _example_transition_and_input(kmh: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and input matrix of eq. 21 over a frame at half load."""
    model = preview_state_matrices(load_vehicle(), kmh * MPS_PER_KMH, ObserverConfig().preview_m)
    return transition_and_input_matrices(*model, FRAME_PERIOD_S)


def _lane_noise_covariance() -> FloatArray:
    """Return R2 (2, 2)."""
    return np.asarray(ObserverConfig("zhang2011").lane_noise * np.eye(2))


def _predicted_covariance_with_curvature_noise(kmh: float) -> FloatArray:
    """Return the predicted covariance (4, 4) at rest with R1 on the curvature input alone."""
    phi, gamma = _example_transition_and_input(kmh)
    noise = ObserverConfig("zhang2011").process_noise * np.outer(gamma[:, 1], gamma[:, 1])
    return steady_predicted_covariance(phi, OBSERVER_OUTPUT_MATRIX, noise, _lane_noise_covariance())


def _bank_index_of_speed(kmh: float) -> int:
    """Return the index of a speed in the bank of observers, which has one per 10 km/h."""
    return round(kmh / 10.0) - 1


def _blended_print_numbers() -> list[MeasuredNumber]:
    """Return the blend (eq. 22) of the printed observers."""
    blended = 0.2 * np.array(PRINTED_STATE_BY_OBSERVER_SPEED_KMH[80.0]) + 0.8 * np.array(
        PRINTED_STATE_BY_OBSERVER_SPEED_KMH[90.0]
    )
    return [
        MeasuredNumber("eq 22", f"blend of the two printed observers: {state}", float(value))
        for state, value in zip(STATE_NAMES, blended, strict=True)
    ]


def _model_state_numbers() -> list[MeasuredNumber]:
    """Return the states of the models of 80, 90 and 88 km/h, 2 s after the angle is applied from straight running."""
    measured = []
    for kmh, whose in ((80.0, "model of 80 km/h"), (90.0, "model of 90 km/h"), (CAR_SPEED_KMH, "car at 88 km/h")):
        state = SIGN_FACTORS_TO_PAPER_STATE * simulate_example_states(kmh)[-1]
        n_states = len(STATE_NAMES) if kmh == CAR_SPEED_KMH else 2
        measured += [MeasuredNumber("eq 22", f"{whose}: {STATE_NAMES[k]}", float(state[k])) for k in range(n_states)]
    return measured


def simulate_example_states(kmh: float) -> FloatArray:
    """Simulate the linear model from straight running under the example's angle, shape (21, 4), our signs."""
    phi, gamma = transition_and_input_matrices(
        *preview_state_matrices(load_vehicle(), kmh * MPS_PER_KMH, ObserverConfig().preview_m), FRAME_PERIOD_S
    )
    states = np.zeros((N_EXAMPLE_FRAMES + 1, 4))
    for k in range(N_EXAMPLE_FRAMES):
        states[k + 1] = phi @ states[k] + gamma @ (EXAMPLE_STEER_RAD, EXAMPLE_CURVATURE_1PM)
    return states


def _observer_state_numbers() -> list[MeasuredNumber]:
    """Return the states of both observers, with the gains of eq. 17, on the car at 88 km/h, and their blend."""
    bank = design_observer_bank(load_vehicle(), ObserverConfig("zhang2011"), FRAME_PERIOD_S)
    actual = simulate_example_states(CAR_SPEED_KMH)
    found = {}
    for kmh in OBSERVER_SPEEDS_KMH:
        at, state = _bank_index_of_speed(kmh), np.zeros(4)
        for true in actual[1:]:
            state = bank.phi[at] @ state + bank.gamma[at] @ (EXAMPLE_STEER_RAD, EXAMPLE_CURVATURE_1PM)
            state = state + bank.gain[at] @ (true[2:] - state[2:])
        found[f"observer of {kmh:.0f} km/h at 88 km/h"] = SIGN_FACTORS_TO_PAPER_STATE * state
    found["blend of both observers at 88 km/h"] = (
        0.2 * found["observer of 80 km/h at 88 km/h"] + 0.8 * found["observer of 90 km/h at 88 km/h"]
    )
    return [
        MeasuredNumber("eq 22", f"{whose}: {name}", float(state[k]))
        for whose, state in found.items()
        for k, name in enumerate(STATE_NAMES)
    ]
