"""The search kernel against its plain twin, and the random numbers against the reference implementation's."""

from __future__ import annotations

import numpy as np
import pytest

from cwcli.kernels import lane_search
from cwcli.vision.boundary import Boundary
from cwcli.vision.objective import compute_block_responses
from cwcli.vision.zhang2011 import FIRST_PHASE, LATER_PHASE, SECOND_PHASE, search_boundary
from tests.unit.vision import naive_search as naive
from tests.unit.vision.parabola_objectives import parabola_objectives
from tests.unit.vision.scenes import LEFT, RIGHT, road_image

GENETIC: lane_search.Genetic = {
    "bits": (6, 7, 7),
    "decimals": (1e4, 1e2, 1.0),
    "generations": 6,
    "crossover_rate": 0.45,
    "mutation_rate": 0.3,
    "wheel_shift": 20.0,
    "with_centre": False,
    "min_blocks": 30,
}


def test_twin_draws_the_numbers_of_the_pcg_reference_demo() -> None:
    # pcg32-demo of the PCG C library, seed 42, stream 54, round 1.
    random = naive.Pcg32(42, 54)
    assert [random.draw() for _ in range(6)] == [
        0xA15C02B7,
        0x7B47F409,
        0xBA1D3330,
        0x83D2F293,
        0xBFA4784B,
        0xCBED606E,
    ]


@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.parametrize("with_centre", [True, False])
@pytest.mark.parametrize("seed", [0, 1, 2**64 - 1])
def test_search_equals_its_twin_bit_for_bit(is_left: bool, with_centre: bool, seed: int) -> None:
    responses = compute_block_responses(road_image(LEFT, RIGHT))
    response = responses.left if is_left else responses.right
    centre, reach = np.array(LEFT if is_left else RIGHT), np.array([0.003, 0.6, 60.0])
    genetic: lane_search.Genetic = {**GENETIC, "with_centre": with_centre}
    arguments = (response, centre - reach, centre + reach, genetic)
    found = lane_search.search(*arguments, is_left=is_left, seed_state=seed, seed_stream=7)
    assert found == naive.search(*arguments, is_left=is_left, seed_state=seed, seed_stream=7)


def test_search_of_a_black_image_draws_uniformly_and_equals_its_twin() -> None:
    response = compute_block_responses(np.zeros((240, 320), np.uint8)).left
    low, high = np.array([-0.005, 0.3, -100.0]), np.array([0.005, 2.3, 150.0])
    genetic: lane_search.Genetic = {
        **GENETIC,
        "bits": (7, 8, 8),
        "generations": 4,
        "mutation_rate": 0.05,
        "wheel_shift": 0.0,
        "min_blocks": 1,
    }
    found = lane_search.search(response, low, high, genetic, is_left=True, seed_state=3, seed_stream=1)
    assert found == naive.search(response, low, high, genetic, is_left=True, seed_state=3, seed_stream=1)
    assert found[1] == 0.0


def test_search_refuses_a_chromosome_that_does_not_fit() -> None:
    response = compute_block_responses(np.zeros((240, 320), np.uint8)).left
    genetic: lane_search.Genetic = {**GENETIC, "bits": (12, 12, 12)}
    with pytest.raises(ValueError, match="36 bits"):
        lane_search.search(response, np.zeros(3), np.ones(3), genetic, is_left=True, seed_state=0, seed_stream=0)


def test_more_blocks_than_the_kernel_has_room_for_are_refused() -> None:
    response = np.zeros((3, 65, 320), np.int16)
    low, high = np.array([-0.005, 0.3, -100.0]), np.array([0.005, 2.3, 150.0])
    with pytest.raises(ValueError, match="65 blocks"):
        lane_search.search(response, low, high, GENETIC, is_left=True, seed_state=0, seed_stream=0)
    with pytest.raises(ValueError, match="65 blocks"):
        lane_search.objective(response, np.array([low]), is_left=True)
    assert lane_search.objective(response[:, :64].copy(), np.array([[0.0, 0.5, 100.0]]), is_left=True)[1][0] == 64


@pytest.mark.parametrize("is_left", [True, False])
def test_objective_equals_its_twin(is_left: bool) -> None:
    rng = np.random.default_rng(4)
    responses = compute_block_responses(rng.integers(0, 256, (240, 320)).astype(np.uint8))
    response = responses.left if is_left else responses.right
    sign = 1.0 if is_left else -1.0
    n = 200
    parabolas = np.column_stack(
        [rng.uniform(-0.005, 0.005, n), sign * rng.uniform(0.1, 2.6, n), rng.uniform(-100, 450, n)]
    )
    parabolas[0] = (0.0, sign * 0.5, -500.0)
    parabolas[1] = (0.0, sign * 2.0, 10.0)
    value, n_blocks = parabola_objectives(response, parabolas, is_left=is_left)
    for k in range(n):
        expected, count = naive.judge(response, parabolas[k], is_left=is_left)
        assert n_blocks[k] == count
        assert value[k] == (expected if count else -np.inf)


def test_previous_result_is_the_first_individual_of_later_phases() -> None:
    # With one generation and no luck the result is at least as good as the previous one.
    responses = compute_block_responses(road_image(LEFT, RIGHT))
    for phase in (SECOND_PHASE, LATER_PHASE):
        for seed in range(20):
            previous = Boundary(-0.0007, 0.71, 25.0, 0.0, 1.0, True)
            value, _ = parabola_objectives(responses.left, np.array([[-0.0007, 0.71, 25.0]]), is_left=True)
            made = search_boundary(responses.left, phase, previous, is_left=True, seed=seed, stream=0)
            assert made.score >= value[0]


def test_same_seed_gives_the_same_result_and_another_one_another() -> None:
    responses = compute_block_responses(road_image(LEFT, RIGHT))

    def found(seed: int, stream: int) -> tuple[float, float, float]:
        made = search_boundary(
            responses.left, FIRST_PHASE, Boundary(0, 0, 0, 0, 0, False), is_left=True, seed=seed, stream=stream
        )
        return made.a, made.b, made.c

    assert found(1, 0) == found(1, 0)
    assert len({found(seed, 0) for seed in range(5)} | {found(1, stream) for stream in range(5)}) > 5
