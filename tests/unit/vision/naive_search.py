"""Plain twins of `cwcli.kernels.lane_search` and of the block responses: the paper's words, one by one."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

MASK_32, MASK_64 = (1 << 32) - 1, (1 << 64) - 1


class Pcg32:
    """PCG-XSH-RR 64/32, as in the reference implementation (pcg32_srandom_r, pcg32_random_r)."""

    def __init__(self, state, stream):
        self.state, self.increment = 0, (stream << 1 | 1) & MASK_64
        self.draw()
        self.state = (self.state + state) & MASK_64
        self.draw()

    def draw(self):
        old = self.state
        self.state = (old * 6364136223846793005 + self.increment) & MASK_64
        shifted, turn = ((old >> 18 ^ old) >> 27) & MASK_32, old >> 59
        return (shifted >> turn | shifted << (-turn & 31)) & MASK_32

    def below(self, n):
        return self.draw() * n >> 32


def block_value(grey, column, row_from_bottom, b, road_grey, *, is_left):
    """alpha dM + sum beta T of one block (eq. 2, 3) as a fraction; column and row count from 1 at the bottom left."""
    v, u = grey.shape[0] - row_from_bottom, column - 1
    block = [[int(value) for value in row] for row in grey[v - 1 : v + 2, u - 1 : u + 2]]
    slope = b if is_left else -b
    mean = Fraction(sum(map(sum, block)), 9)

    def part(cells):
        return Fraction(sum(block[i][j] for i, j in cells), 3)

    above_left = part([(0, 0), (0, 1), (1, 0)])
    below_right = part([(1, 2), (2, 1), (2, 2)])
    above_right = part([(0, 1), (0, 2), (1, 2)])
    below_left = part([(1, 0), (2, 0), (2, 1)])
    upper, lower = part([(0, 0), (0, 1), (0, 2)]), part([(2, 0), (2, 1), (2, 2)])
    left, right = part([(0, 0), (1, 0), (2, 0)]), part([(0, 2), (1, 2), (2, 2)])
    diagonal = abs(above_left - below_right) if is_left else abs(above_right - below_left)
    alpha, beta, beta3, beta4 = (4, 6, 0, 0)
    if slope > 2:
        alpha, beta, beta3, beta4 = (2, 5, 3, 0)
    elif slope < 0.5:
        alpha, beta, beta3, beta4 = (2, 5, 0, 3)
    total = alpha * (mean - road_grey) + beta * diagonal + beta3 * abs(upper - lower) + beta4 * abs(left - right)
    return total / 10


def judge(response, abc, *, is_left):
    """Eq. 2, 3 from a response array."""
    a, b, c = abc
    slope = b if is_left else -b
    kind = 1 if slope > 2 else 2 if slope < 0.5 else 0
    total, n = 0, 0
    for i in range(response.shape[1]):
        y = 2.0 + 3.0 * i
        x = math.floor((a * y + b) * y + c + 0.5)
        if 2 <= x <= response.shape[2] - 1:
            total += int(response[kind, i, x - 1])
            n += 1
    return (total / (90.0 * n), n) if n else (-1e300, 0)


def decode(code, low, high, genetic):
    """Eq. 5, rounded."""
    bits, decimals = genetic["bits"], genetic["decimals"]
    made, shift = [], sum(bits)
    for k in range(3):
        shift -= bits[k]
        number = code >> shift & (1 << bits[k]) - 1
        value = low[k] + number / ((1 << bits[k]) - 1) * (high[k] - low[k])
        made.append(math.floor(value * decimals[k] + 0.5) / decimals[k])
    return made


def crossover(first, second, points, n):
    """Swap characters of the second and fourth segment."""
    p, q, r = points
    one, two = f"{first:0{n}b}", f"{second:0{n}b}"
    child = one[:p] + two[p:q] + one[q:r] + two[r:]
    other = two[:p] + one[p:q] + two[q:r] + one[r:]
    return int(child, 2), int(other, 2)


def search(response, low, high, genetic, *, is_left, seed_state, seed_stream):
    """The genetic search with chromosomes as strings; returns a, b, c and the objective."""
    bits, shift = genetic["bits"], genetic["wheel_shift"]
    random, n, population = Pcg32(seed_state, seed_stream), sum(bits), 50

    def fitness_of(code):
        value, n_blocks = judge(response, decode(code, low, high, genetic), is_left=is_left)
        return value if n_blocks >= genetic["min_blocks"] else -1e300

    parents = [random.draw() >> (32 - n) for _ in range(population)]
    if genetic["with_centre"]:
        parents[0] = int("".join("1" + "0" * (k - 1) for k in bits), 2)
    fitness = [fitness_of(code) for code in parents]
    best_value = max(fitness)
    best = parents[fitness.index(best_value)]
    for _ in range(genetic["generations"]):
        wheel = np.cumsum([max(value + shift, 0.0) for value in fitness])
        children = []
        for _ in range(population):
            if wheel[-1] > 0:
                ball = random.draw() / 2.0**32 * wheel[-1]
                children.append(parents[min(int(np.searchsorted(wheel, ball, side="right")), population - 1)])
            else:
                children.append(parents[random.below(population)])
        for i in range(population):
            if random.draw() < int(genetic["crossover_rate"] * 2**32):
                points: list[int] = []
                while len(points) < 3:
                    point = 1 + random.below(n - 1)
                    if point not in points:
                        points.append(point)
                after = (i + 1) % population
                children[i], children[after] = crossover(children[i], children[after], sorted(points), n)
        for i in range(population):
            if random.draw() < int(genetic["mutation_rate"] * 2**32):
                children[i] ^= 1 << (n - 1 - random.below(n))
        parents, fitness = children, [fitness_of(code) for code in children]
        worst = fitness.index(min(fitness))
        parents[worst], fitness[worst] = best, best_value
        if max(fitness) > best_value:
            best_value = max(fitness)
            best = parents[fitness.index(best_value)]
    return tuple(decode(best, low, high, genetic)), best_value


def block_responses(grey, nine_road, weights):
    """Twin of the kernel's responses, whole rows at a time: (3, 50, 320) for the left and the right boundary."""
    rows = grey[90:].reshape(50, 3, 320)[::-1].astype(int)
    upper, middle, lower = rows[:, 0], rows[:, 1], rows[:, 2]
    left, centre, right = slice(0, -2), slice(1, -1), slice(2, None)
    columns = upper + middle + lower
    contrast = columns[:, left] + columns[:, centre] + columns[:, right] - nine_road
    t1 = upper[:, left] + upper[:, centre] + middle[:, left] - middle[:, right] - lower[:, centre] - lower[:, right]
    t2 = upper[:, right] + upper[:, centre] + middle[:, right] - middle[:, left] - lower[:, centre] - lower[:, left]
    t3 = upper[:, left] + upper[:, centre] + upper[:, right] - lower[:, left] - lower[:, centre] - lower[:, right]
    t4 = columns[:, left] - columns[:, right]
    made = []
    for diagonal in (t1, t2):
        response = np.zeros((3, 50, 320), int)
        for k, (alpha, beta, beta_other) in enumerate(weights):
            other = t3 if k == 1 else t4
            gradient = beta * abs(diagonal) + beta_other * abs(other)
            response[k, :, 1:-1] = alpha * contrast + 3 * gradient
        made.append(response)
    return made
