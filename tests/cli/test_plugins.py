"""Packages of others add rules, motion models, measures, lane methods, inputs; a bad one is an error that names it."""

from __future__ import annotations

import importlib.metadata
import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

from cwcli.errors import EXIT_USAGE
from cwcli.evaluation.doubts import DOUBT_RULES
from cwcli.events import EVENTS
from cwcli.logs.read.reader import Log
from cwcli.measures import MEASURES
from cwcli.prediction.models import MODELS
from cwcli.registry import _find_installed_plugins
from cwcli.signals.inputs import INPUTS_BY_SCHEMA_NAME
from cwcli.vision.methods import METHODS
from cwcli.warning.rules import RULES
from tests.cli.conftest import ROOT, Run
from tests.cli.plugin_package import ENTRY_POINTS, MODULES, install
from tests.unit.vision import lane_logs
from tests.work import count_calls
from tools.reference import pages

T0_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
KNOTS, MPS = 20.0, 20.0 * 1852.0 / 3600.0


@pytest.fixture(scope="module")
def extra(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment in which the package is installed."""
    return with_path(install(tmp_path_factory.mktemp("site")))


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A camera's log."""
    return Path(lane_logs.write_log(tmp_path_factory.mktemp("frames") / "frames.mcap", lane_logs.road_frames(3)))


def with_path(*folders: Path) -> dict[str, str]:
    return {"PYTHONPATH": os.pathsep.join(map(str, (*folders, ROOT)))}


def ship_log(path: Path) -> Path:
    """Ten seconds of a ship that goes north at 20 knots: positions, and its own log."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = [
            writer.register_channel(topic, "json", writer.register_schema(schema, "jsonschema", b"{}"))
            for topic, schema in (("/gps", "foxglove.LocationFix"), ("/log", "ship_msgs/msg/Log"))
        ]
        for k in range(100):
            at = T0_NS + k * STEP_NS
            stamp = {"timestamp": {"sec": at // 10**9, "nsec": at % 10**9}}
            fix = {"latitude": 54.0 + k * 0.1 * MPS / 111_320.0, "longitude": 10.0, "altitude": 0.0}
            for channel, message in zip(channels, (fix, {"knots": KNOTS}), strict=True):
                writer.add_message(channel, at, json.dumps(stamp | message).encode(), at)
        writer.finish()
    return path


def test_the_package_is_one_to_importlib_too(tmp_path: Path) -> None:
    (found,) = importlib.metadata.distributions(path=[str(install(tmp_path))])
    names = {(entry.group, entry.name, entry.value) for entry in found.entry_points}
    assert names == {(group, name, target) for group, each in ENTRY_POINTS.items() for name, target in each.items()}
    plugins = _find_installed_plugins((str(tmp_path),))
    assert names == {(group, plugin.name, plugin.target) for group, each in plugins.items() for plugin in each}


@pytest.mark.parametrize(
    ("command", "line"),
    [
        ("warn", "near: centres nearer than 30 m."),
        ("run", "near: centres nearer than 30 m."),
        ("warn", ", tenth < 0.5 m"),
        ("predict", "half: half of the acceleration."),
        ("lanes", "middle: two upright lines."),
    ],
)
def test_help_lists_plugins(cwcli: Run, extra: dict[str, str], command: str, line: str) -> None:
    shown = " ".join(cwcli(command, "--help", env=extra).stdout.decode().split())
    assert line in shown
    assert line not in " ".join(cwcli(command, "--help").stdout.decode().split())


def test_no_plugins_leaves_them_out(cwcli: Run, extra: dict[str, str], intersection: Path) -> None:
    """In front of the command, and by the environment, which worker processes inherit."""
    line = b"half: half of the acceleration"
    assert line in b" ".join(cwcli("predict", "--help", env=extra).stdout.split())
    hidden = cwcli("--no-plugins", "predict", "--help", env=extra)
    assert hidden.returncode == 0
    assert line not in b" ".join(hidden.stdout.split())
    done = cwcli("warn", intersection, "--rule", "near", env=extra | {"CWCLI_NO_PLUGINS": "1"})
    assert done.returncode == EXIT_USAGE
    assert b"near" in done.stderr.splitlines()[0]


def test_generated_docs_leave_plugins_out(extra: dict[str, str]) -> None:
    """The pages are committed: they must be the same whatever is installed beside cwcli."""
    code = "from tools.reference import pages; import json; print(json.dumps({str(k): v for k, v in pages().items()}))"
    assert json.loads(run_python(code, extra)) == {str(path): path.read_text(encoding="utf-8") for path in pages()}


def test_a_registry_lists_plugins_as_the_docs_would(extra: dict[str, str]) -> None:
    code = """
from pathlib import Path
from tools.registry_reference import lanes_page, measures_page, prediction_page, signals_page, warning_page
print(measures_page())
for page in (lanes_page, prediction_page, signals_page, warning_page):
    print(page(Path(f"docs/{page.__name__.removesuffix('_page')}.md").read_text()))
"""
    shown = " ".join(run_python(code, extra).split())
    assert "## `tenth` q = d_c / 10 Column `min_tenth_m`. Source: made up." in shown
    assert "Source: made up. Threshold:" not in shown  # it has no source
    assert "| `tenth` | tenth of the distance | m | low | < 0.5 m |" in shown
    assert "`ship_msgs/Log`" in shown
    assert "| `near` | centres nearer than 30 m | none |" in shown
    assert "| `half` | half of the acceleration | yes | | | |" in shown
    assert "| `middle` | two upright lines |" in shown


def run_python(code: str, environment: Mapping[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_model_and_rule_of_a_package_run(cwcli: Run, extra: dict[str, str], intersection: Path, tmp_path: Path) -> None:
    arguments = ("--predict-model", "half", "--warn-rule", "near", "-o", "out.mcap", "--quiet")
    done = cwcli("run", intersection, *arguments, env=extra)
    assert done.returncode == 0, done.stderr.decode()
    with Log.open(tmp_path / "out.mcap") as log:
        warnings, paths = log.columns("/cwcli/warnings"), log.columns("/cwcli/ego/path")
    assert warnings.fields["rule"].values == ("near",)  # type: ignore[union-attr]
    assert paths.fields["model"].values == ("half",)  # type: ignore[union-attr]


def test_measure_of_a_package_is_a_column_and_a_conflict(
    cwcli: Run, extra: dict[str, str], intersection: Path, tmp_path: Path
) -> None:
    arguments = ("-o", "out.mcap", "--metrics-dir", "m", "--quiet", "--warn-conflict", "tenth < 0.3")
    done = cwcli("run", intersection, *arguments, env=extra)
    assert done.returncode == 0, done.stderr.decode()
    (pair,) = pq.read_table(tmp_path / "m" / "pairs.parquet").to_pylist()
    (conflict,) = pq.read_table(tmp_path / "m" / "conflicts.parquet").to_pylist()
    least_m = pair["min_distance_m"]
    assert pair["min_tenth_m"] == pytest.approx(0.1 * least_m)
    assert conflict["onset_stamp_ns"] < conflict["closest_stamp_ns"] < conflict["end_stamp_ns"]
    judged = json.loads(cwcli("evaluate", "out.mcap", "--json", env=extra).stdout)
    assert judged["logs"][0]["metrics"]["warnings.conflicts_count"]["value"] == 1
    assert cwcli("report", "out.mcap", "-o", "out.html", env=extra).returncode == 0
    assert "the tenth of the distance was below 0.3 m" in (tmp_path / "out.html").read_text()
    without = cwcli("evaluate", "out.mcap")
    assert without.returncode == EXIT_USAGE
    assert b"there is no measure 'tenth'" in without.stderr


def test_lane_method_of_a_package_runs(cwcli: Run, extra: dict[str, str], frames: Path, tmp_path: Path) -> None:
    done = cwcli("lanes", frames, "--method", "middle", "-o", "out.mcap", "--quiet", env=extra)
    assert done.returncode == 0, done.stderr.decode()
    with Log.open(tmp_path / "out.mcap") as log:
        feet = log.columns("/cwcli/lanes").fields["left.c"]
    np.testing.assert_array_equal(feet, [40.0, 40.0, 40.0])  # a quarter of 160


def test_input_of_a_package_fills_its_role(cwcli: Run, extra: dict[str, str], tmp_path: Path) -> None:
    log = ship_log(tmp_path / "ship.mcap")
    roles = [json.loads(cwcli("info", log, "--json", env=env).stdout)["channels"][1]["roles"] for env in (extra, {})]
    assert roles == [["ego_speed"], []]
    done = cwcli("estimate", log, "-o", "out.mcap", "--json", env=extra)
    assert done.returncode == 0, done.stderr.decode()
    with Log.open(tmp_path / "out.mcap") as annotated:
        speed = np.asarray(annotated.columns("/cwcli/ego/state").fields["speed_mps"])
    np.testing.assert_allclose(speed[20:-20], MPS, atol=0.05)


def broken(folder: Path, module: str, old: str, new: str) -> dict[str, str]:
    """The environment of a package in which one module has been changed."""
    assert old in MODULES[module]
    return with_path(install(folder / "site", modules=MODULES | {module: MODULES[module].replace(old, new)}))


@pytest.mark.parametrize(
    ("module", "old", "new", "said"),
    [
        ("rule", "import numpy as np", "import nothing_like_it", "can't be imported: ModuleNotFoundError: No module"),
        ("rule", "RULE = Rule(", "RULE = dict(", "is no Rule but a dict"),
        ("rule", "RULE = Rule(", "RULE = Rule(measures=('pet',), ", "'pet', which needs more than the two states"),
        ("rule", "RULE = Rule(", "RULE = Rule(words='danger {x}', ", "where {other} alone may stand in braces"),
        ("rule", "RULE = Rule(", "RULE = Rule(words='{', ", "where {other} alone may stand in braces"),
        (
            "rule",
            "RULE = Rule(",
            "RULE = Rule(measures=('tttc',), ",
            "'tttc', which does not exist",
        ),
        (
            "rule",
            "near = ",
            "1 / 0; near = ",
            "raised in decide: ZeroDivisionError: division by zero (rule.py, line",
        ),
        ("rule", "near = ", "raise SystemExit(0); near = ", "raised in decide: SystemExit: 0 (rule.py, line"),
        (
            "rule",
            "near = ",
            "raise BaseException('stop'); near = ",
            "raised in decide: BaseException: stop (rule.py, line",
        ),
        ("rule", "import numpy as np", "raise GeneratorExit", "can't be imported: GeneratorExit (rule.py, line"),
        ("rule", "persistence_s=0.0", "persistence_s='0'", "has persistence_s = '0', which is no float"),
        ("measure", "threshold=0.5", "threshold='0.5'", "has threshold = '0.5', which is no float | None"),
        ("measure", 'symbol="q"', "symbol=None", "has symbol = None, which is no str"),
        ("rule", "< 30.0", "< 30.0; near = near[1:]", "returned from decide what it must not: armed is bool of shape"),
        ("rule", "return Decision(near", "return Decision(near * 1.0", "armed is float64 of shape"),
        ("rule", "return Decision(", "return (lambda *all: all)(", "a tuple, no Decision"),
        ("model", "return Responses(0.5 * time_s", "return Responses(time_s[1:]", "speed_to_accel has shape"),
        ("model", "return Responses(0.5 * time_s", "raise KeyError(0.5", "raised in responses: KeyError"),
        (
            "model",
            "trust=full_trust",
            "trust=lambda state, *others: state[:, :4]",
            "a factor that is not between",
        ),
        ("model", "trust=full_trust", "trust=lambda state, *others: state", "trust what it must not: shape"),
        (
            "measure",
            "return pair.distance_m / 10.0",
            "return pair.distance_m[1:]",
            "compute what it must not: float64 of",
        ),
        ("measure", "pair.distance_m / 10.0", "pair.distances", "raised in compute: AttributeError"),
        ("measure", "MEASURE = Measure(", "MEASURE = (lambda **all: tuple(all))(", "is no Measure but a tuple"),
        ("measure", '"tenth_m"', '"distance_m"', "calls its column distance_m, not by its own name"),
        ("measure", "from cwcli.measures.base", "from cwcli.measures.bases", "can't be imported: ModuleNotFoundError"),
        ("method", "return LaneFit(*sides)", "return sides", "returned from step what it must not"),
        ("method", "for place in (0.25", "for place in (0.25 / 0", "raised in step: ZeroDivisionError"),
        ("method", "def step", "def stride", "makes a Middle, which has no step"),
        ("method", "(160, 90)", "(160.0, 90)", "is no (width_px, height_px)"),
        ("speed", "return signal, ledger.quality", "return signal", "it is no (signal, Quality)"),
        ("speed", "speed_mps[rows], nan,", "speed_mps, nan[1:],", "yaw_rate_radps has 99 rows, not 100"),
        ("speed", "Role.EGO_SPEED", "Role.EGO_HEADING", "SpeedSignal for ego_heading, not HeadingSignal"),
        ("speed", "ledger.quality\n", "ledger.quality.__class__('', '')\n", "100 messages, 0 of them read"),
        ("speed", "INPUT = Input(", "INPUT = (lambda *all: list(all))(", "is no Input but a list"),
    ],
)
def test_a_plugin_that_fails_is_named_and_nothing_is_written(
    cwcli: Run, module: str, old: str, new: str, said: str, intersection: Path, frames: Path, tmp_path: Path
) -> None:
    arguments: dict[str, tuple[Any, ...]] = {
        "rule": ("run", intersection, "--warn-rule", "near"),
        "model": ("run", intersection, "--predict-model", "half"),
        "measure": ("run", intersection),
        "method": ("lanes", frames, "--method", "middle"),
        "speed": ("estimate", ship_log(tmp_path / "ship.mcap")),
    }
    environment = broken(tmp_path, module, old, new)
    done = cwcli(
        *arguments[module],
        "-o",
        "out.mcap",
        *(("--metrics-dir", "out") if arguments[module][0] == "run" else ("--metrics", "out.csv")),
        env=environment,
    )
    text = " ".join(done.stderr.decode().split())
    assert done.returncode == EXIT_USAGE, text
    assert text.startswith("error: "), text
    assert said in text
    assert "' of the package extra 1.2 " in text
    assert "uninstall extra" in text
    assert "Traceback" not in text
    assert not list(tmp_path.glob("out*"))


def test_a_broken_plugin_hurts_only_who_asks_for_it(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    environment = broken(tmp_path, "rule", "import numpy as np", "import nothing_like_it")
    assert cwcli("run", intersection, "-o", "out.mcap", "--quiet", env=environment).returncode == 0
    shown = " ".join(cwcli("warn", "--help", env=environment).stdout.decode().split())
    assert "near: the warning rule 'near' of the package extra 1.2 can't be imported: ModuleNotFoundError" in shown


@pytest.mark.parametrize(
    ("group", "name", "command"),
    [
        ("cwcli.rules", "ttc", "warn"),
        ("cwcli.motion_models", "cv", "predict"),
        ("cwcli.measures", "ttc", "warn"),
        ("cwcli.rules", "lane-departure", "warn"),
        ("cwcli.motion_models", "onset", "predict"),
        ("cwcli.lane_methods", "zhang2011", "lanes"),
        ("cwcli.inputs", "sensor_msgs/msg/NavSatFix", "info"),
    ],
)
def test_a_name_that_cwcli_has_is_refused(
    cwcli: Run, group: str, name: str, command: str, intersection: Path, tmp_path: Path
) -> None:
    site = install(tmp_path / "site", {group: {name: "extra.rule:RULE"}})
    done = cwcli(command, intersection, env=with_path(site))
    assert done.returncode == EXIT_USAGE
    text = " ".join(done.stderr.decode().split())
    assert f"'{name}' of the package extra 1.2 has the name of one of cwcli's own" in text


def test_a_name_that_another_package_has_is_refused(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    points = {"cwcli.rules": {"near": "extra.rule:RULE"}}
    sites = [install(tmp_path / package, points, package=package) for package in ("extra", "more")]
    done = cwcli("warn", intersection, env=with_path(*sites))
    assert done.returncode == EXIT_USAGE
    text = " ".join(done.stderr.decode().split())
    assert "'near' of the package more 1.2 has the name of one of the package extra 1.2" in text


def test_the_first_of_a_package_on_the_path_counts(tmp_path: Path) -> None:
    one = install(tmp_path / "one", {"cwcli.rules": {"near": "extra.rule:RULE"}})
    two = install(tmp_path / "two", {"cwcli.rules": {"far": "extra.rule:FAR"}})
    assert [plugin.name for plugin in _find_installed_plugins((str(one), str(two)))["cwcli.rules"]] == ["near"]


def example(name: str, folder: Path) -> dict[str, str]:
    """The environment of an example of docs/plugins.md."""
    page = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    examples = zip(*(re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL) for kind in ("toml", "python")), strict=True)
    found = {
        tomllib.loads(project)["project"]["name"]: (tomllib.loads(project)["project"], code)
        for project, code in examples
    }
    project, code = found.pop(name)
    return with_path(install(folder / "site", project["entry-points"], {"__init__": code}, package=name))


def obeys_laws(file: str, name: str, environment: Mapping[str, str]) -> None:
    """The laws of its registry hold for an entry of a package."""
    laws = ("-m", "pytest", "-q", f"tests/laws/{file}", "-k", name)
    judged = subprocess.run(
        [sys.executable, *laws],
        check=False,
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
    )
    assert judged.returncode == 0, judged.stdout


def test_the_measure_of_the_docs_works(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    environment = example("timegap", tmp_path)
    arguments = ("--warn-conflict", "time-gap", "--metrics-dir", "m", "--quiet")
    done = cwcli("run", intersection, *arguments, env=environment)
    assert done.returncode == 0, done.stderr.decode()
    (pair,) = pq.read_table(tmp_path / "m" / "pairs.parquet").to_pylist()
    assert 0.0 < pair["min_time_gap_s"] < 1.0
    assert pq.read_table(tmp_path / "m" / "conflicts.parquet").num_rows == 1
    obeys_laws("test_measures.py", "time-gap", environment)


def test_the_rule_of_the_docs_warns_by_measures(cwcli: Run, intersection: Path, tmp_path: Path) -> None:
    environment = example("harsh", tmp_path)
    arguments = ("-o", "out.mcap", "--warn-rule", "harsh", "--metrics-dir", "m", "--quiet")
    done = cwcli("run", intersection, *arguments, env=environment)
    assert done.returncode == 0, done.stderr.decode()
    (event,) = pq.read_table(tmp_path / "m" / "events.parquet").to_pylist()
    assert event["rule"] == "harsh"
    done = cwcli("measure", "out.mcap", "--states", "online", "--measures", "drac", "--metrics-dir", "n", "--quiet")
    assert done.returncode == 0, done.stderr.decode()
    measured = pq.read_table(tmp_path / "n" / "measures.parquet")
    stamp_ns, drac = (np.asarray(measured[name]) for name in ("stamp_ns", "drac_mps2"))
    needed_s = 1e-9 * (event["raised_stamp_ns"] - stamp_ns[np.flatnonzero(drac > 3.35)[0]])
    assert 0.05 <= needed_s <= 0.25  # persistence, a step more, and as much as the other's state was brought forward
    obeys_laws("test_rules.py", "harsh", environment)


def test_the_page_of_plugins_knows_every_group() -> None:
    page = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(cwcli\.\w+)`", page, re.MULTILINE) == [
        registry.group for registry in (RULES, MODELS, MEASURES, DOUBT_RULES, EVENTS, METHODS, INPUTS_BY_SCHEMA_NAME)
    ]


def test_looking_for_plugins_is_a_few_calls_for_each_package(tmp_path: Path) -> None:
    """A start pays for it: importlib.metadata makes some hundred calls for each."""
    for k in range(300):
        install(tmp_path, {"console_scripts": {f"tool{k}": "tool:main"}}, {}, package=f"tool{k}")
        if k % 3:  # of the packages of a development environment about a third has any
            (tmp_path / f"tool{k}-1.2.dist-info" / "entry_points.txt").unlink()
    found = []
    assert count_calls(lambda: found.append(_find_installed_plugins((str(tmp_path), "no folder")))) < 20 * 300
    assert found == [{}]
