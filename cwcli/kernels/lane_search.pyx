# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""zhang2011's genetic search for one lane boundary, and the objective of given parabolas.

The objective reads block responses that were computed once per frame (`cwcli.vision.objective`): integers, in 1/90 grey
level. So the sum along a parabola is exact, and one division gives the same number on every machine. All other
arithmetic is +, -, * and / of doubles in a fixed order (compiled with -ffp-contract=off), and no function of libm.

Random numbers: PCG32 (O'Neill 2014, XSH-RR 64/32), seeded by state and stream as in its reference implementation. A number
below n is the upper half of the 64-bit product n * u32; an event of probability p happens if u32 < p * 2^32.

The plain NumPy twin is in tests/unit/vision/naive_search.py.
"""

ctypedef unsigned int uint32
ctypedef unsigned long long uint64

from libc.stdlib cimport abs

import numpy as np

cdef enum:
    MAX_WIDTH = 512
    MAX_BLOCKS = 64
    POPULATION = 50
    WHEEL_STEPS = 6
    WHEEL = 1 << WHEEL_STEPS  # more than the population
    MAX_BITS = 30
    KNOWN_BITS = 11
    KNOWN = 1 << KNOWN_BITS  # chromosomes whose fitness is kept

cdef double TWO_32 = 4294967296.0


cdef struct Pcg:
    uint64 state
    uint64 increment


cdef struct Genetic:
    int bits[3]            # length of each parameter's string, 4 to 30 in all
    double decimals[3]     # 10^m for m decimals, to which the parameters are rounded
    int generations        # after the first population
    double crossover_rate  # probability per individual, below 1
    double mutation_rate   # likewise
    double wheel_shift     # added to the fitness on the roulette wheel, grey levels
    bint with_centre       # the first individual is the middle of the region (the previous result), not a random one
    int min_blocks         # a candidate with fewer blocks on the image is the worst there is; 1 at least


cdef struct Region:
    double low[3]
    double span[3]
    double decimals[3]
    uint32 largest[3]
    int shift[3]
    int bits


cdef inline uint32 draw(Pcg* random) noexcept nogil:
    cdef uint64 old = random.state
    random.state = old * <uint64>6364136223846793005ULL + random.increment
    cdef uint32 shifted = <uint32>(((old >> 18) ^ old) >> 27)
    cdef uint32 turn = <uint32>(old >> 59)
    return (shifted >> turn) | (shifted << ((32 - turn) & 31))


cdef inline void seed(Pcg* random, uint64 state, uint64 stream) noexcept nogil:
    random.state = 0
    random.increment = (stream << 1) | 1
    draw(random)
    random.state += state
    draw(random)


cdef inline uint32 below(Pcg* random, uint32 n) noexcept nogil:
    return <uint32>((<uint64>draw(random) * n) >> 32)


cdef inline double rounded(double value, double per_unit) noexcept nogil:
    """To the nearest multiple of 1 / per_unit, halves up."""
    cdef double shifted = value * per_unit + 0.5
    cdef long long whole = <long long>shifted
    if <double>whole > shifted:
        whole -= 1
    return <double>whole / per_unit


cdef inline void decode(const Region* region, uint32 code, double* abc) noexcept nogil:
    """Eq. 5, rounded to the decimals of each parameter."""
    cdef int k
    cdef double number
    for k in range(3):
        number = <double>((code >> region.shift[k]) & region.largest[k])
        abc[k] = rounded(region.low[k] + number / <double>region.largest[k] * region.span[k], region.decimals[k])


cdef double judge(
    const short[:, :, ::1] response, double a, double b, double c, bint is_left, int min_blocks, int* n_blocks
) noexcept nogil:
    """Eq. 2, 3: mean response of the blocks on the image; -1e300 if there are fewer than min_blocks."""
    cdef double slope = b if is_left else -b
    cdef Py_ssize_t kind = 1 if slope > 2.0 else (2 if slope < 0.5 else 0)
    cdef Py_ssize_t width = response.shape[2]
    cdef const short* row = &response[kind, 0, 0]
    cdef double end = <double>width
    cdef double x, y
    cdef long long total = 0
    cdef int place[MAX_BLOCKS]
    cdef int n = 0, i
    for i in range(<int>response.shape[1]):  # vector code, so it stands alone
        y = 2.0 + 3.0 * i
        x = (a * y + b) * y + c + 0.5  # the block's centre is the whole part of x, 2 to width - 1
        place[i] = <int>(x if 2.0 <= x < end else 1.0) - 1
    for i in range(<int>response.shape[1]):
        total += row[place[i]]  # the outermost columns hold zeros
        n += place[i] > 0
        row += width
    n_blocks[0] = n
    if n < min_blocks:
        return -1e300
    return <double>total / (90.0 * n)


cdef struct Known:
    # fitness by chromosome; a later one takes the place of one with the same hash
    uint32 code[KNOWN]
    double value[KNOWN]


cdef inline double fitness_of(
    Known* known, const Region* region, uint32 code, const short[:, :, ::1] response, bint is_left, int min_blocks
) noexcept nogil:
    """`judge` of a chromosome. A population that draws together asks for few again and again."""
    cdef double abc[3]
    cdef int n_blocks
    cdef uint32 place = (code * <uint32>2654435769U) >> (32 - KNOWN_BITS)  # Fibonacci hashing: 2^32 over the golden ratio
    if known.code[place] != code:
        decode(region, code, abc)
        known.value[place] = judge(response, abc[0], abc[1], abc[2], is_left, min_blocks, &n_blocks)
        known.code[place] = code
    return known.value[place]


cdef void combine(short* out, const short* contrast, const short* diagonal, const short* other, int alpha, int beta,
                  int beta_other, Py_ssize_t width) noexcept nogil:
    cdef Py_ssize_t u
    for u in range(1, width - 1):
        out[u] = <short>(alpha * contrast[u] + beta * diagonal[u] + beta_other * other[u])


def block_responses(const unsigned char[:, ::1] grey, int nine_road, int n_blocks):
    # Tables 1 and 2, times 90: 10 alpha, 30 beta. Row by row through small arrays of 16 bits: nothing overflows, and
    # the compiler makes vector code of each loop.
    left_array = np.zeros((3, n_blocks, grey.shape[1]), np.int16)
    cdef short[:, :, ::1] left = left_array
    right_array = np.zeros_like(left_array)
    cdef short[:, :, ::1] right = right_array
    cdef Py_ssize_t height = grey.shape[0]
    cdef Py_ssize_t width = grey.shape[1]
    cdef Py_ssize_t i, u
    cdef const unsigned char* upper
    cdef const unsigned char* middle
    cdef const unsigned char* lower
    cdef short columns[MAX_WIDTH], contrast[MAX_WIDTH]
    cdef short t1[MAX_WIDTH], t2[MAX_WIDTH], t3[MAX_WIDTH], t4[MAX_WIDTH]
    cdef short road = <short>nine_road
    if width > MAX_WIDTH:
        raise ValueError(f"{width} columns")
    with nogil:
        for i in range(left.shape[1]):
            upper = &grey[height - 3 * i - 3, 0]
            middle = upper + width
            lower = middle + width
            for u in range(width):
                columns[u] = <short>(upper[u] + middle[u] + lower[u])
            for u in range(1, width - 1):
                contrast[u] = <short>(columns[u - 1] + columns[u] + columns[u + 1] - road)
            for u in range(1, width - 1):
                t4[u] = <short>abs(columns[u - 1] - columns[u + 1])
            for u in range(1, width - 1):
                t1[u] = <short>abs(upper[u - 1] + upper[u] + middle[u - 1] - middle[u + 1] - lower[u] - lower[u + 1])
            for u in range(1, width - 1):
                t2[u] = <short>abs(upper[u] + upper[u + 1] + middle[u + 1] - middle[u - 1] - lower[u - 1] - lower[u])
            for u in range(1, width - 1):
                t3[u] = <short>abs(upper[u - 1] + upper[u] + upper[u + 1] - lower[u - 1] - lower[u] - lower[u + 1])
            combine(&left[0, i, 0], contrast, t1, t4, 4, 18, 0, width)
            combine(&left[1, i, 0], contrast, t1, t3, 2, 15, 9, width)
            combine(&left[2, i, 0], contrast, t1, t4, 2, 15, 9, width)
            combine(&right[0, i, 0], contrast, t2, t4, 4, 18, 0, width)
            combine(&right[1, i, 0], contrast, t2, t3, 2, 15, 9, width)
            combine(&right[2, i, 0], contrast, t2, t4, 2, 15, 9, width)
    return left_array, right_array


def objective(const short[:, :, ::1] response, const double[:, ::1] parabolas, *, bint is_left):
    if response.shape[1] > MAX_BLOCKS:
        raise ValueError(f"{response.shape[1]} blocks")
    value_array = np.empty(parabolas.shape[0])
    cdef double[::1] value = value_array
    n_blocks_array = np.empty(parabolas.shape[0], np.int32)
    cdef int[::1] n_blocks = n_blocks_array
    cdef Py_ssize_t i
    with nogil:
        for i in range(parabolas.shape[0]):
            value[i] = judge(response, parabolas[i, 0], parabolas[i, 1], parabolas[i, 2], is_left, 1, &n_blocks[i])
    return value_array, n_blocks_array


cdef uint32 cross(Pcg* random, uint32* first, uint32* second, int bits) noexcept nogil:
    """Three-point crossover: the second and the fourth of the four segments change places. 0 if they are equal."""
    cdef uint32 p = 1 + below(random, bits - 1)
    cdef uint32 q = 1 + below(random, bits - 1)
    cdef uint32 r
    cdef uint32 low, middle, high, differing
    while q == p:
        q = 1 + below(random, bits - 1)
    r = 1 + below(random, bits - 1)
    while r == p or r == q:
        r = 1 + below(random, bits - 1)
    low = min(p, q, r)
    high = max(p, q, r)
    middle = p + q + r - low - high
    differing = (first[0] ^ second[0]) & segments(low, middle, high, bits)
    first[0] ^= differing
    second[0] ^= differing
    return differing


cdef inline uint32 segments(uint32 p, uint32 q, uint32 r, int bits) noexcept nogil:
    """Bits p to q and r to the end, counted from the left of a string of `bits` bits."""
    cdef uint32 from_p = (<uint32>1 << (bits - p)) - 1
    cdef uint32 from_q = (<uint32>1 << (bits - q)) - 1
    cdef uint32 from_r = (<uint32>1 << (bits - r)) - 1
    return (from_p ^ from_q) | from_r


def crossover_mask(int p, int q, int r, int bits):
    return segments(p, q, r, bits)


def mutation_mask(int place, int bits):
    return <uint32>1 << (bits - 1 - place)


cdef void set_region(Region* region, const double[::1] low, const double[::1] high, const Genetic* genetic) noexcept nogil:
    cdef const int* bits = genetic.bits
    cdef int k
    region.bits = bits[0] + bits[1] + bits[2]
    region.shift[0] = bits[1] + bits[2]
    region.shift[1] = bits[2]
    region.shift[2] = 0
    for k in range(3):
        region.low[k] = low[k]
        region.span[k] = high[k] - low[k]
        region.decimals[k] = genetic.decimals[k]
        region.largest[k] = (<uint32>1 << bits[k]) - 1


def decode_code(uint32 code, const double[::1] low, const double[::1] high, Genetic genetic):
    cdef Region region
    cdef double abc[3]
    set_region(&region, low, high, &genetic)
    decode(&region, code, abc)
    return abc[0], abc[1], abc[2]


def search(
    const short[:, :, ::1] response,
    const double[::1] low,
    const double[::1] high,
    Genetic genetic,
    *,
    bint is_left,
    uint64 seed_state,
    uint64 seed_stream,
):
    cdef Region region
    cdef Pcg random
    cdef Known judged
    cdef uint32 parents[POPULATION], children[POPULATION]
    cdef double fitness[POPULATION], known[POPULATION], wheel[WHEEL], abc[3]
    cdef bint is_new[POPULATION]
    cdef int min_blocks = genetic.min_blocks
    cdef double wheel_shift = genetic.wheel_shift
    cdef double total, ball, best_value
    cdef uint32 best
    cdef uint32 crossover_below = <uint32>(genetic.crossover_rate * TWO_32)
    cdef uint32 mutation_below = <uint32>(genetic.mutation_rate * TWO_32)
    cdef int i, after, low_i, middle, worst, generation
    set_region(&region, low, high, &genetic)
    if response.shape[1] > MAX_BLOCKS:
        raise ValueError(f"{response.shape[1]} blocks")
    if min_blocks < 1:
        raise ValueError(f"at least {min_blocks} blocks")
    if region.bits > MAX_BITS or region.bits < 4:
        raise ValueError(f"a chromosome of {region.bits} bits")
    with nogil:
        seed(&random, seed_state, seed_stream)
        for i in range(POPULATION, WHEEL):
            wheel[i] = 1e300
        for i in range(KNOWN):
            judged.code[i] = <uint32>0xFFFFFFFFU  # none has so many bits
        best = 0
        best_value = -2e300
        for i in range(POPULATION):
            parents[i] = draw(&random) >> (32 - region.bits)
        if genetic.with_centre:
            # 2^(k-1) decodes to the middle of the region plus less than half a step: to the middle, once it is rounded.
            parents[0] = 0
            for i in range(3):
                parents[0] |= ((region.largest[i] >> 1) + 1) << region.shift[i]
        for i in range(POPULATION):
            fitness[i] = fitness_of(&judged, &region, parents[i], response, is_left, min_blocks)
            if fitness[i] > best_value:
                best_value = fitness[i]
                best = parents[i]
        for generation in range(genetic.generations):
            # Selection by a roulette wheel (eq. 7); a field is as wide as the shifted fitness, none if that is negative.
            total = 0.0
            for i in range(POPULATION):
                if fitness[i] + wheel_shift > 0.0:
                    total += fitness[i] + wheel_shift
                wheel[i] = total
            for i in range(POPULATION):
                if total > 0.0:
                    ball = <double>draw(&random) / TWO_32 * total
                    low_i = 0  # how many fields end at or before the ball; without branches, which no processor would guess
                    for after in range(WHEEL_STEPS):
                        middle = WHEEL >> (after + 1)
                        low_i += middle * (wheel[low_i + middle - 1] <= ball)
                    low_i = min(low_i, POPULATION - 1)
                else:
                    low_i = below(&random, POPULATION)
                children[i] = parents[low_i]
                known[i] = fitness[low_i]
                is_new[i] = False
            for i in range(POPULATION):
                if draw(&random) < crossover_below:
                    after = (i + 1) % POPULATION
                    if cross(&random, &children[i], &children[after], region.bits) != 0:
                        is_new[i] = True
                        is_new[after] = True
            for i in range(POPULATION):
                if draw(&random) < mutation_below:
                    children[i] ^= <uint32>1 << (region.bits - 1 - below(&random, region.bits))
                    is_new[i] = True
            worst = 0
            for i in range(POPULATION):
                parents[i] = children[i]
                fitness[i] = known[i]  # a copy is as fit as its original
                if is_new[i]:
                    fitness[i] = fitness_of(&judged, &region, parents[i], response, is_left, min_blocks)
                if fitness[i] < fitness[worst]:
                    worst = i
            # Elitism: the best so far takes the place of the worst; then the best so far is brought up to date.
            parents[worst] = best
            fitness[worst] = best_value
            for i in range(POPULATION):
                if fitness[i] > best_value:
                    best_value = fitness[i]
                    best = parents[i]
        decode(&region, best, abc)
    return (abc[0], abc[1], abc[2]), best_value
