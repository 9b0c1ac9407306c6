"""Files as 100 programs write them become the drive of `real_drive`, or are refused with their question."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest

from cwcli.errors import CwcliError
from cwcli.importing.mapping import read_mapping
from cwcli.importing.run import plan_import, write_import
from cwcli.importing.tables import Answers
from cwcli.importing.utm import geographic_of_utm_deg
from tests.unit.importing.device_files import DEVICE_FILES
from tests.unit.importing.real_drive import measure_errors
from tests.unit.importing.real_files import REAL_FILES
from tests.unit.importing.real_tables import BOUNDS, REAL_TABLES
from tests.unit.importing.wild_files import WILD_FILES

CASES = REAL_TABLES | REAL_FILES | WILD_FILES | DEVICE_FILES


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.asks])
def test_real_file_becomes_the_drive(name: str, tmp_path: Path) -> None:
    """Every quantity that the file holds is made, and is right."""
    case = CASES[name]
    write_import(plan_import([str(path) for path in case.make(tmp_path)], Answers()), str(tmp_path / "log.mcap"))
    errors = measure_errors(tmp_path / "log.mcap", case.start)
    assert set(errors) == set(case.holds.split())
    bounds = BOUNDS | case.bounds
    assert {each: error for each, error in errors.items() if not error <= bounds[each]} == {}


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.asks])
def test_real_file_is_refused_with_its_question(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    with pytest.raises(CwcliError, match=case.asks) as found:
        plan_import([str(path) for path in case.make(tmp_path)], Answers())
    assert found.value.hint


def test_grid_becomes_the_drive_by_its_zone_and_by_its_mapping(tmp_path: Path) -> None:
    """The grid was made with PROJ, zone 56 of the south."""
    files = [str(path) for path in WILD_FILES["utm_columns"].make(tmp_path)]
    answers = Answers({("", "x"): ("utm_easting", "EPSG:32756")})
    plan = plan_import(files, answers)
    write_import(plan, str(tmp_path / "log.mcap"))
    assert measure_errors(tmp_path / "log.mcap")["fix"] <= BOUNDS["fix"]
    (tmp_path / "again.toml").write_text(plan.mapping_text())
    again = plan_import(files, read_mapping(str(tmp_path / "again.toml")))
    assert again.topics == plan.topics
    kept = plan_import(files, Answers({("", "x"): ("utm_easting", "m")}))
    assert [topic for topic, *_ in kept.topics] == ["/pose"]


def test_places_of_utm_are_those_of_proj() -> None:
    rng = np.random.default_rng(5)
    for zone, is_south in ((1, False), (33, False), (56, True)):
        north_deg, east_deg = (
            rng.uniform(0, 83, 500) * (-1 if is_south else 1),
            6 * zone - 183 + rng.uniform(-4, 4, 500),
        )
        to_grid = pyproj.Transformer.from_crs(4326, 32600 + 100 * is_south + zone, always_xy=True)
        x_m, y_m = map(np.asarray, to_grid.transform(east_deg, north_deg))
        found = geographic_of_utm_deg(x_m, y_m, zone, is_south)
        np.testing.assert_allclose(found, (north_deg, east_deg), atol=1e-8)  # a millimeter
