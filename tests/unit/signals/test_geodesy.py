"""The local map against hand-made geometry, an independent implementation, and itself backwards."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

from cwcli.signals.columns import FloatArray
from cwcli.signals.geodesy import LocalMap

ATOL_M = 1e-6
A_M = 6_378_137.0
E2 = 2.0 / 298.257223563 - 1.0 / 298.257223563**2


def ecef(lat_deg: FloatArray, lon_deg: FloatArray, alt_m: FloatArray) -> FloatArray:
    """WGS84 to geocentric, from the textbook formula; shape (3, n)."""
    lat, lon = np.deg2rad(lat_deg), np.deg2rad(lon_deg)
    n = A_M / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    return np.stack(
        [
            (n + alt_m) * np.cos(lat) * np.cos(lon),
            (n + alt_m) * np.cos(lat) * np.sin(lon),
            (n * (1 - E2) + alt_m) * np.sin(lat),
        ]
    )


def enu(local: LocalMap, lat_deg: FloatArray, lon_deg: FloatArray, alt_m: FloatArray) -> FloatArray:
    """Independent east-north-up: rotation of the geocentric difference; shape (3, n)."""
    origin = np.array([local.origin_lat_deg]), np.array([local.origin_lon_deg]), np.array([local.origin_alt_m])
    lat, lon = np.deg2rad(local.origin_lat_deg), np.deg2rad(local.origin_lon_deg)
    rotation = np.array(
        [
            [-np.sin(lon), np.cos(lon), 0.0],
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        ]
    )
    return rotation @ (ecef(lat_deg, lon_deg, alt_m) - ecef(*origin))


ORIGINS = [(51.039553, 13.792498, 111.52), (40.8647049, -77.8305529, 331.0), (-33.9, 151.2, 0.0), (0.0, 180.0, 10.0)]


@pytest.mark.parametrize("origin", ORIGINS, ids=["dresden", "pennsylvania", "sydney", "antimeridian"])
def test_map_from_wgs84_agrees_with_rotated_geocentric_difference(origin: tuple[float, float, float]) -> None:
    local = LocalMap(*origin)
    rng = np.random.default_rng(11)
    lat, lon = origin[0] + rng.uniform(-0.5, 0.5, 500), origin[1] + rng.uniform(-0.5, 0.5, 500)
    alt = origin[2] + rng.uniform(-100, 1000, 500)
    np.testing.assert_allclose(np.stack(local.map_from_wgs84(lat, lon, alt)), enu(local, lat, lon, alt), atol=ATOL_M)


@pytest.mark.parametrize("origin", ORIGINS, ids=["dresden", "pennsylvania", "sydney", "antimeridian"])
def test_wgs84_from_map_is_the_exact_inverse(origin: tuple[float, float, float]) -> None:
    local = LocalMap(*origin)
    xyz = np.random.default_rng(12).uniform(-1.0, 1.0, (3, 1000)) * np.array([[50_000.0], [50_000.0], [1000.0]])
    np.testing.assert_allclose(np.stack(local.map_from_wgs84(*local.wgs84_from_map(*xyz))), xyz, atol=ATOL_M)


def test_map_from_wgs84_one_degree_of_the_equator_by_hand() -> None:
    x, y, z = LocalMap(0.0, 0.0, 0.0).map_from_wgs84(np.zeros(1), np.ones(1), np.zeros(1))
    assert x[0] == pytest.approx(A_M * np.sin(np.pi / 180), abs=ATOL_M)
    assert y[0] == pytest.approx(0.0, abs=ATOL_M)
    assert z[0] == pytest.approx(A_M * (np.cos(np.pi / 180) - 1), abs=ATOL_M)


def test_map_from_wgs84_axes_are_east_north_up() -> None:
    local = LocalMap(48.0, 9.0, 100.0)
    x, y, z = local.map_from_wgs84(
        np.array([48.0, 48.001, 48.0]), np.array([9.001, 9.0, 9.0]), np.array([100.0, 100.0, 130.0])
    )
    assert x[0] > 70.0
    assert y[1] > 100.0
    np.testing.assert_allclose([x[2], y[2], z[2]], [0.0, 0.0, 30.0], atol=ATOL_M)


def test_map_from_wgs84_without_altitude_keeps_the_plane_position() -> None:
    local = LocalMap(48.0, 9.0, 100.0)
    lat, lon = np.array([48.01, np.nan]), np.array([9.01, 9.0])
    x, y, z = local.map_from_wgs84(lat, lon, np.array([np.nan, 5.0]))
    reference_x, reference_y, _ = local.map_from_wgs84(lat[:1], lon[:1], np.array([100.0]))
    assert (x[0], y[0]) == (reference_x[0], reference_y[0])
    assert np.isnan([z[0], x[1], y[1]]).all()


def test_wgs84_from_map_leaves_its_arguments_alone() -> None:
    x = np.array([1.0, 2.0])
    LocalMap(48.0, 9.0).wgs84_from_map(x, x, x)
    np.testing.assert_array_equal(x, [1.0, 2.0])


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(91.0, 0.0), (np.nan, 0.0), (0.0, 181.0), (0.0, np.inf)])
def test_local_map_refuses_an_origin_that_is_no_place(lat_deg: float, lon_deg: float) -> None:
    with pytest.raises(ValueError, match="not a place"):
        LocalMap(lat_deg, lon_deg)


def proj(origin: tuple[float, float, float]) -> Transformer:
    """PROJ's own pipeline from degrees to the plane."""
    latitude_deg, longitude_deg, altitude_m = origin
    return Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude_deg!r} +lon_0={longitude_deg!r} +h_0={altitude_m!r}"
    )


@pytest.mark.parametrize("origin", [*ORIGINS, (90.0, 0.0, 0.0), (-89.99999, -180.0, -30.0)])
def test_the_plane_has_the_bits_of_proj(origin: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(13)
    near = np.array(origin[:2])[:, None] + rng.normal(0.0, 0.02, (2, 5000))
    lat, lon = np.concatenate([near, rng.uniform(-180.0, 180.0, (2, 5000)) * [[0.5], [1.0]]], axis=1)
    lat[:6], lon[6:9] = [90.0, -90.0, 90.0 + 1e-11, 90.1, 0.0, 95.0], [180.0, 540.0, 600.0]  # some are no places
    alt = rng.uniform(-100.0, 9000.0, len(lat))
    xyz = proj(origin).transform(lon.copy(), lat.copy(), alt.copy())
    is_place = np.isfinite(xyz[0])
    assert not is_place[[3, 5, 8]].any()
    assert np.count_nonzero(is_place) > 5000
    found = LocalMap(*origin).map_from_wgs84(lat, lon, alt)
    for mine, theirs in zip(found, xyz, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("origin", [*ORIGINS, (90.0, 0.0, 0.0)])
def test_the_way_back_has_the_bits_of_proj(origin: tuple[float, float, float]) -> None:
    xyz = np.random.default_rng(14).normal(0.0, 1.0, (3, 10_000)) * np.repeat([10.0, 1e3, 1e5, 1e7], 2500)
    x, y, z = xyz.copy()
    lon, lat, alt = proj(origin).transform(x, y, z, direction="INVERSE")
    for mine, theirs in zip(LocalMap(*origin).wgs84_from_map(*xyz), (lat, lon, alt), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_map_that_was_used_can_be_pickled() -> None:
    local = LocalMap(48.0, 9.0, 100.0)
    local.map_from_wgs84(np.zeros(1), np.zeros(1), np.zeros(1))
    assert repr(pickle.loads(pickle.dumps(local))) == repr(local)


def test_positions_may_be_single_numbers() -> None:
    place: Any = (np.float64(48.0), np.float64(9.0), np.float64(130.0))
    x, y, z = LocalMap(48.0, 9.0, 100.0).map_from_wgs84(*place)
    assert np.shape(x) == ()
    np.testing.assert_allclose([x, y, z], [0.0, 0.0, 30.0], atol=ATOL_M)
