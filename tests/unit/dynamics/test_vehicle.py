"""Vehicle files: the shipped one is table 5; what is wrong is named in one line."""

from pathlib import Path

import pytest

from cwcli.dynamics.vehicle import load_vehicle, vehicle_names
from cwcli.errors import InputError, UsageError

GOOD = """
front_axle_m = 1.2
rear_axle_m = 1.5
front_stiffness_nprad = 90000.0
rear_stiffness_nprad = 110000
yaw_inertia_kgm2 = 2500.0
[load_kg]
usual = 1500.0
"""


def test_the_papers_car_is_table_5() -> None:
    car = load_vehicle("zhang2011")
    assert (car.front_axle_m, car.rear_axle_m) == (0.90, 1.06)
    assert car.wheelbase_m == pytest.approx(1.96)
    assert (car.front_stiffness_nprad, car.rear_stiffness_nprad, car.yaw_inertia_kgm2) == (60000.0, 60000.0, 2100.0)
    assert dict(car.load_kg) == {"empty": 960.0, "half": 1215.0, "full": 1460.0}
    assert (car.mass_kg, car.correction_mass_kg) == (1215.0, 1215.0)
    assert vehicle_names() == ("zhang2011",)


def test_another_load_keeps_the_steering_correction() -> None:
    car = load_vehicle(load="full")
    assert (car.mass_kg, car.correction_mass_kg) == (1460.0, 1215.0)


def test_a_file_of_ones_own(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(GOOD)
    car = load_vehicle(file)
    assert (car.mass_kg, car.width_m, car.camera_forward_m) == (1500.0, 1.8, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param(
            "90000.0", "-90000.0", "front_stiffness_nprad is -90000.0; permitted: 1000 to", id="reversed sign"
        ),
        pytest.param("= 1.2", "= -1.2", "front_axle_m is -1.2; permitted: 0.1 to 10 m", id="reversed axle"),
        pytest.param("= 1.2", '= "1.2"', "front_axle_m is '1.2'; permitted", id="text"),
        pytest.param("= 1.2", "= true", "front_axle_m is True; permitted", id="boolean"),
        pytest.param("= 1.2", "= nan", "front_axle_m is nan; permitted", id="not a number"),
        pytest.param("= 1.2", f"= {10**400}", "front_axle_m is 1000", id="too long for a float"),
        pytest.param("= 1.2", f"= 1{'0' * 5000}", "not TOML", id="too long for an integer"),
        pytest.param("= 1.2", f"= {'[' * 5000}{']' * 5000}", "not TOML", id="too deep"),
        pytest.param(
            "[load_kg]", "[use]\nload = []\n[load_kg]", "use.load is []; permitted: usual", id="a list to use"
        ),
        pytest.param("usual = 1500.0", "", "load_kg is missing or empty", id="no load"),
        pytest.param("usual = 1500.0", "usual = -1.0", "load_kg.usual is -1.0; permitted: 50 to", id="negative mass"),
        pytest.param("yaw_inertia_kgm2 = 2500.0", "", "yaw_inertia_kgm2 is missing", id="missing key"),
        pytest.param("rear_axle_m", "rear_axel_m", "rear_axel_m is unknown; permitted: name", id="unknown key"),
        pytest.param("[load_kg]", '[use]\nload = "none"\n[load_kg]', "use.load is 'none'; permitted: usual", id="use"),
        pytest.param("[load_kg]", "[use]\nlaod = 1\n[load_kg]", "use.laod is unknown", id="unknown use"),
        pytest.param("= 1.2", "= ", "not TOML", id="not TOML"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(UsageError) as caught:
        load_vehicle(file)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_unknown_names_and_files(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there is no vehicle 'tank'"):
        load_vehicle("tank")
    with pytest.raises(InputError, match="can't be read"):
        load_vehicle(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="can't be read"):
        load_vehicle("zero\0byte.toml")
    with pytest.raises(UsageError, match="load 'laden' is unknown; permitted: empty, half, full"):
        load_vehicle(load="laden")
