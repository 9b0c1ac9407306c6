"""Textures of asphalt, verge, leaves' shadow and worn paint, averaged over the stretch that each row shows.

A row near the horizon covers metres of road, one at the bottom centimetres. So that far texture neither flickers nor
aliases, each texture is kept as its running sum along the road: the mean over a row's stretch of road is a difference
of two sums. Textures have fixed seeds, so they are the same in every process; scenes take different parts of them.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from cwcli.lazy_dataclass import dataclass
from cwcli.signals.columns import FloatArray

Float32Array = npt.NDArray[np.float32]

TEXTURE_CELL_WIDTH_M = 0.04
"""Width of a texture's cell across the road, m. Chosen by hand; not fitted."""
TEXTURE_HALF_WIDTH_M = 12.0
"""Largest offset that the textures cover on each side, m. Chosen by hand; not fitted."""
TEXTURE_CELL_LENGTH_M = 0.05
"""Length of a texture's cell along the road, m. Chosen by hand; not fitted."""
N_TEXTURE_CELLS_ALONG_ROAD = 2048
"""Number of a texture's cells along the road, after which it repeats. Chosen by hand; not fitted."""
N_TEXTURE_CELLS_ACROSS_ROAD = round(2 * TEXTURE_HALF_WIDTH_M / TEXTURE_CELL_WIDTH_M)
"""Number of a texture's cells across the road."""
TEXTURE_CELL_OFFSETS_M: Float32Array = (
    (np.arange(N_TEXTURE_CELLS_ACROSS_ROAD) + 0.5) * TEXTURE_CELL_WIDTH_M - TEXTURE_HALF_WIDTH_M
).astype(np.float32)
"""Offsets of the cells' centres from the lane's centre, shape (cells,), m."""

REMAINING_PAINT_LEVELS = (0.3, 0.45, 0.6, 0.75, 0.9)
"""Shares of paint that is left for which a wear texture is made; a marking takes the nearest one. Chosen by hand; not
fitted."""
WEAR_CELL_WIDTH_M = 0.01
"""Width of a wear texture's cell across a marking, m. Chosen by hand; not fitted."""
N_WEAR_TEXTURE_CELLS_ACROSS_MARKING = 64
"""Number of a wear texture's cells across a marking. Chosen by hand; not fitted."""


@dataclass(frozen=True)
class Texture:
    """A texture that repeats along the road, with mean 0.

    Attributes:
        sums: Shape (cells along + 1, cells across): running sum along the road times the length of a cell.
    """

    sums: Float32Array

    def mean_over_stretches(self, start_m: FloatArray, end_m: FloatArray, shift: int = 0) -> Float32Array:
        """Mean of the texture over stretches of road.

        Args:
            start_m, end_m: Shape (n,): stations, end after start.
            shift: Cells to move sideways (cyclic).

        Returns:
            Shape (n, cells).
        """
        length = np.maximum(end_m - start_m, 1e-3).astype(np.float32)[:, None]
        if np.array_equal(start_m[:-1], end_m[1:]):  # neighbouring rows share an edge
            sums = self._running_sum_at(np.concatenate([end_m[:1], start_m]))
            mean = (sums[:-1] - sums[1:]) / length
        else:
            mean = (self._running_sum_at(end_m) - self._running_sum_at(start_m)) / length
        return np.roll(mean, shift, axis=1) if shift else mean

    def _running_sum_at(self, station_m: FloatArray) -> Float32Array:
        """The running sum from station 0 to the stations (n,), shape (n, cells); it repeats with the texture."""
        place = np.mod(station_m / TEXTURE_CELL_LENGTH_M, N_TEXTURE_CELLS_ALONG_ROAD)
        low = np.minimum(place.astype(np.intp), N_TEXTURE_CELLS_ALONG_ROAD - 1)
        part = (place - low).astype(np.float32)[:, None]
        below = self.sums[low]
        return np.asarray(below + part * (self.sums[low + 1] - below))


def _make_texture(values: FloatArray) -> Texture:
    """Make a texture of mean 0 from values (cells along, cells across)."""
    centred = (values - values.mean(axis=0)) * TEXTURE_CELL_LENGTH_M
    return Texture(np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(centred, axis=0)]).astype(np.float32))


def _draw_smooth_noise(rng: np.random.Generator, shape: tuple[int, int], size: tuple[float, float]) -> FloatArray:
    """Draw smooth cyclic noise of standard deviation 1; `size` is its sigma in cells along and across."""
    along, across = (np.fft.fftfreq(n) for n in shape)
    filtered = np.exp(-2 * np.pi**2 * ((along[:, None] * size[0]) ** 2 + (across[None, :] * size[1]) ** 2))
    noise = np.fft.ifft2(np.fft.fft2(rng.standard_normal(shape)) * filtered).real
    return np.asarray(noise / noise.std())


@cache
def asphalt_texture() -> Texture:
    """The relative grey of asphalt: grain, streaks along the road, blotches."""
    rng = np.random.default_rng(101)
    shape = (N_TEXTURE_CELLS_ALONG_ROAD, N_TEXTURE_CELLS_ACROSS_ROAD)
    grain = rng.standard_normal(shape)
    streaks = _draw_smooth_noise(rng, shape, (80.0, 1.5))
    blotches = _draw_smooth_noise(rng, shape, (25.0, 12.0))
    return _make_texture(0.09 * grain + 0.035 * streaks + 0.03 * blotches)


@cache
def verge_texture() -> Texture:
    """The relative grey of grass and gravel beside the road."""
    rng = np.random.default_rng(102)
    shape = (N_TEXTURE_CELLS_ALONG_ROAD, N_TEXTURE_CELLS_ACROSS_ROAD)
    return _make_texture(
        0.22 * _draw_smooth_noise(rng, shape, (1.5, 2.0)) + 0.16 * _draw_smooth_noise(rng, shape, (20.0, 12.0))
    )


@cache
def crack_texture() -> Texture:
    """The relative grey of sealed cracks: thin dark lines along and across the road."""
    rng = np.random.default_rng(103)
    texture = np.zeros((N_TEXTURE_CELLS_ALONG_ROAD, N_TEXTURE_CELLS_ACROSS_ROAD))
    for _ in range(9):  # along, wandering
        length = int(rng.integers(100, 500))
        start = int(rng.integers(0, N_TEXTURE_CELLS_ALONG_ROAD))
        path = rng.integers(60, N_TEXTURE_CELLS_ACROSS_ROAD - 60) + np.cumsum(rng.normal(0.0, 0.25, length))
        texture[
            (start + np.arange(length)) % N_TEXTURE_CELLS_ALONG_ROAD,
            np.clip(path.round().astype(int), 0, N_TEXTURE_CELLS_ACROSS_ROAD - 1),
        ] = -0.35
    for _ in range(7):  # across
        start, slant = int(rng.integers(0, N_TEXTURE_CELLS_ALONG_ROAD)), rng.normal(0.0, 0.15)
        at = (
            start
            + slant * np.arange(N_TEXTURE_CELLS_ACROSS_ROAD)
            + np.cumsum(rng.normal(0.0, 0.4, N_TEXTURE_CELLS_ACROSS_ROAD))
        )
        texture[at.round().astype(int) % N_TEXTURE_CELLS_ALONG_ROAD, np.arange(N_TEXTURE_CELLS_ACROSS_ROAD)] = -0.35
    return _make_texture(np.minimum(texture, np.roll(texture, 1, axis=0)))


@cache
def leaf_shadow_texture() -> Texture:
    """The shadow of leaves: 1 in shadow, 0 in sun, half the road each, less the mean."""
    rng = np.random.default_rng(104)
    shape = (N_TEXTURE_CELLS_ALONG_ROAD, N_TEXTURE_CELLS_ACROSS_ROAD)
    field = _draw_smooth_noise(rng, shape, (14.0, 14.0)) + 0.7 * _draw_smooth_noise(rng, shape, (4.0, 4.0))
    return _make_texture(1.0 / (1.0 + np.exp(-6.0 * field)))


@cache
def remaining_paint_texture_and_mean(level: float) -> tuple[Texture, FloatArray]:
    """The texture of worn paint, 1 where paint is left and 0 where it is gone less the mean, and the mean per cell."""
    rng = np.random.default_rng(105)
    shape = (N_TEXTURE_CELLS_ALONG_ROAD, N_WEAR_TEXTURE_CELLS_ACROSS_MARKING)
    field = (
        _draw_smooth_noise(rng, shape, (5.0, 5.0))
        + 0.8 * _draw_smooth_noise(rng, shape, (60.0, 30.0))
        + 0.5 * rng.standard_normal(shape)
    )
    remaining_paint = (field > np.quantile(field, 1.0 - level)).astype(np.float64)
    return _make_texture(remaining_paint), remaining_paint.mean(axis=0)
