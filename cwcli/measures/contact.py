"""First contact of two rectangles that keep their headings, in closed form by the separating axes.

On each of the four edge directions the centres' distance is c + s t + q t^2 / 2, and the projections overlap while that
is at most the reach R in size; the rectangles overlap when all four do. Without acceleration each direction overlaps
during one interval of time, with it during at most two.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cwcli.kernels.encounters import accelerated_contact_time
from cwcli.lazy_dataclass import dataclass
from cwcli.measures.pair import OtherInHostAxes, Pair
from cwcli.signals.columns import FloatArray


@dataclass(frozen=True)
class EdgeProjections:
    """The relative motion on the four edge directions, (4, m): the host's two, then the other's.

    Attributes:
        centre_m, speed_mps: Position and speed of the other's centre relative to the host's.
        reach_m: Sum of the half extents.
        cos_turn, sin_turn: Cosine and sine of the other's heading relative to the host's, (m,).
    """

    centre_m: FloatArray
    speed_mps: FloatArray
    reach_m: FloatArray
    cos_turn: FloatArray
    sin_turn: FloatArray

    @classmethod
    def from_pair(cls, pair: Pair) -> EdgeProjections:
        """The projections in the rows `near` of a pair."""
        at: OtherInHostAxes = pair.other_in_host_axes
        (length, width), (their_length, their_width) = pair.host_size, pair.other_size
        cosine, sine = np.abs(at.cos_turn), np.abs(at.sin_turn)
        return cls(
            project_vectors_on_four_edge_directions(at.x_m, at.y_m, at.cos_turn, at.sin_turn),
            project_vectors_on_four_edge_directions(at.vx_mps, at.vy_mps, at.cos_turn, at.sin_turn),
            np.stack(
                [
                    at.reach_x_m,
                    at.reach_y_m,
                    0.5 * (their_length + length * cosine + width * sine),
                    0.5 * (their_width + length * sine + width * cosine),
                ]
            ),
            at.cos_turn,
            at.sin_turn,
        )

    def select_rows(self, rows: npt.NDArray[np.intp]) -> EdgeProjections:
        """The projections of some rows."""
        return EdgeProjections(*(getattr(self, name)[..., rows] for name in self.__dataclass_fields__))

    def with_motion(self, x_m: FloatArray, y_m: FloatArray, vx_mps: FloatArray, vy_mps: FloatArray) -> EdgeProjections:
        """The projections of another position and velocity of the other in the host's axes, (m,) or (k, m)."""
        return EdgeProjections(
            project_vectors_on_four_edge_directions(x_m, y_m, self.cos_turn, self.sin_turn),
            project_vectors_on_four_edge_directions(vx_mps, vy_mps, self.cos_turn, self.sin_turn),
            self.reach_m,
            self.cos_turn,
            self.sin_turn,
        )


def project_vectors_on_four_edge_directions(
    along_m: FloatArray, left_m: FloatArray, cos_turn: FloatArray, sin_turn: FloatArray
) -> FloatArray:
    """Project a vector in the host's axes on the four edge directions, (4, m)."""
    return np.stack([along_m, left_m, along_m * cos_turn + left_m * sin_turn, left_m * cos_turn - along_m * sin_turn])


def straight_contact_time_s(edges: EdgeProjections) -> FloatArray:
    """Seconds until contact at constant velocities, (m,): 0 in contact, infinity if never."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.where(np.abs(edges.speed_mps) < 1e-9, 0.0, edges.speed_mps)
        one, two = (-edges.reach_m - edges.centre_m) * inverse, (edges.reach_m - edges.centre_m) * inverse
    # 0 times infinity: touching on a direction along which nothing moves, which bounds no time
    begin = np.maximum(np.fmin(one, two).max(axis=0, initial=0.0), 0.0)
    return np.where(begin <= np.fmax(one, two).min(axis=0), begin, np.inf)


def accelerated_contact_time_s(edges: EdgeProjections, ax_mps2: FloatArray, ay_mps2: FloatArray) -> FloatArray:
    """Seconds until contact at constant relative acceleration along the host's axes, (m,): infinity if never."""
    ax_mps2, ay_mps2 = np.broadcast_arrays(ax_mps2, ay_mps2)
    shape = edges.centre_m.shape
    bend = project_vectors_on_four_edge_directions(ax_mps2, ay_mps2, edges.cos_turn, edges.sin_turn)
    centre, speed, reach, bend = (
        np.ascontiguousarray(np.broadcast_to(each if each.ndim == len(shape) else each[:, None], shape)).reshape(4, -1)
        for each in (edges.centre_m, edges.speed_mps, edges.reach_m, bend)
    )
    return accelerated_contact_time(centre, speed, reach, bend).reshape(shape[1:])
