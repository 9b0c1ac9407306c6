"""A user's own net: its description, its output as a map of markings, and the lanes that are found on it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from cwcli.errors import InputError, UsageError
from cwcli.vision.method import LaneFrame
from cwcli.vision.methods import METHODS, check_method_and_model, load_method
from cwcli.vision.onnx_model import LaneNet, read_net_description, read_onnx_input_shape
from tests.set_frames import render_set_frame
from tests.unit.vision.lane_scene import mounted, score
from tests.unit.vision.onnx_file import convolution

RIDGES = """
kind = "segmentation"
size = [320, 150]
colour = "grey"
mean = 0.0
std = 1.0
top = 0.375
classes = 1
lanes = 0
activation = "sigmoid"
"""
ANCHORS = """
kind = "row-anchor"
size = [80, 40]
colour = "rgb"
mean = [0.5, 0.5, 0.5]
std = [0.25, 0.25, 0.25]
axes = ["cell", "row", "lane"]
rows = [9, 19, 29, 39]
cells = 10
lanes = 2
"""


def ridge_net(folder: Path, text: str = RIDGES) -> Path:
    """A net whose only kernel is a bright stripe between dark ones, at the scale of the paper's camera."""
    row = np.where(np.abs(np.arange(-10, 11)) <= 3, 1.0 / 7.0, -1.0 / 14.0) * 40.0
    weights = np.tile(row, (3, 1))[None, None] / 3.0
    path = folder / "ridges.onnx"
    path.write_bytes(convolution(weights.astype(np.float32), np.array([-6.0], np.float32), (320, 150), pad=(1, 10)))
    path.with_suffix(".toml").write_text(text)
    return path


def anchor_net(folder: Path, text: str = ANCHORS) -> Path:
    """A net that says of every anchor and both lanes, whatever it sees: cell 3, and surely so."""
    bias = np.where(np.arange(11) == 3, 30.0, 0.0).astype(np.float32)
    path = folder / "anchors.onnx"
    path.write_bytes(convolution(np.zeros((11, 3, 10, 40), np.float32), bias, (80, 40), stride=(10, 40)))
    path.with_suffix(".toml").write_text(text)
    return path


def test_map_of_a_segmentation_is_the_convolution_by_hand(tmp_path: Path) -> None:
    net = LaneNet(ridge_net(tmp_path))
    assert net.description.search_size() == (320, 240)  # 150 rows below the 37.5 % that are cut off
    grey = np.full((240, 320), 51, np.uint8)
    grey[:, 157:164] = 153  # seven columns
    made = net.compute_marking_map(grey)
    # On the stripe: 40 (153 - 51) / 255 = 16, less 6; beside it 0, less 6.
    assert made[200, 160] == pytest.approx(1.0 / (1.0 + math.exp(-10.0)), abs=1e-5)
    assert made[200, 60] == pytest.approx(1.0 / (1.0 + math.exp(6.0)), abs=1e-5)
    assert (made[:90] == 0.0).all()


def test_lanes_are_found_on_the_map_of_a_net(tmp_path: Path) -> None:
    method = load_method("onnx", str(ridge_net(tmp_path)))
    assert method.search_size(1280, 960) == (320, 240)
    right = []
    for index in range(6):
        made = render_set_frame("good", index)
        fit = method.make(0).step(LaneFrame(made.grey, mounted(), 0, 0))
        assert math.isnan(fit.left.probability)
        right.append(score(fit, made.truth).is_correct)
    assert sum(right) >= 5


def test_columns_of_row_anchors_become_stripes(tmp_path: Path) -> None:
    net = LaneNet(anchor_net(tmp_path))
    made = net.compute_marking_map(np.zeros((40, 80), np.uint8))
    # Cell 3 of ten in 80 columns: 24 to 32, the middle between columns 27 and 28; anchors in rows 9 to 39.
    assert made[20].argmax() in (27, 28)
    assert made[20, 27] == pytest.approx(math.exp(-0.5 * 0.25**2), abs=1e-3)
    assert made[20, 60] == 0.0
    assert made[5].max() == 0.0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            ("classes = 1", "classes = 2"),
            r"the output is 1 x 1 x 150 x 320, but ridges\.toml describes 1 x 2 x any x any",
        ),
        (("size = [320, 150]", "size = [640]"), r"size is \[640\]"),
        (('kind = "segmentation"', ""), "kind is missing"),
        (("lanes = 0", "lanes = 7"), "lanes is 7"),
        (("top = 0.375", "tops = 0.375"), "tops is unknown for segmentation"),
        (("std = 1.0", "std = 0.0"), "std is 0.0"),
        (('activation = "sigmoid"', 'activation = "relu"'), "activation is 'relu'"),
        (("kind =", "kind"), "not TOML"),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    path = ridge_net(tmp_path, RIDGES.replace(*change))
    with pytest.raises((InputError, UsageError), match=told):
        LaneNet(path).compute_marking_map(np.zeros((240, 320), np.uint8))


def test_channels_that_the_net_has_not_are_told(tmp_path: Path) -> None:
    text = (
        RIDGES.replace('"grey"', '"rgb"')
        .replace("mean = 0.0", "mean = [0, 0, 0]")
        .replace("std = 1.0", "std = [1, 1, 1]")
    )
    with pytest.raises(InputError, match=r"expects 1 x 1 x 150 x 320, but ridges\.toml describes 1 x 3 x 150 x 320"):
        LaneNet(ridge_net(tmp_path, text)).compute_marking_map(np.zeros((240, 320), np.uint8))


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    path = ridge_net(tmp_path)
    path.with_suffix(".toml").unlink()
    with pytest.raises(InputError, match=r"ridges\.toml: can't be read: No such file"):
        LaneNet(path)


def test_whole_numbers_where_onnx_has_messages_say_no_shape(tmp_path: Path) -> None:
    number_as_graph, number_as_weights, number_as_input = b"\x38\x05", b"\x3a\x02\x28\x05", b"\x3a\x02\x58\x05"
    for content in (number_as_graph, number_as_weights, number_as_input):
        assert read_onnx_input_shape(content) == ()
    path = ridge_net(tmp_path)
    path.write_bytes(number_as_graph)
    with pytest.raises(InputError, match="can't load the net"):
        LaneNet(path)


def test_a_file_that_is_no_net_and_axes_that_are_none_are_told(tmp_path: Path) -> None:
    path = ridge_net(tmp_path)
    path.write_bytes(b"no net")
    with pytest.raises(InputError, match="can't load the net"):
        LaneNet(path)
    anchors = anchor_net(tmp_path, ANCHORS.replace('"lane"]', '"line"]'))
    with pytest.raises(UsageError, match="axes is"):
        read_net_description(anchors.with_suffix(".toml"))


def test_model_and_method_belong_together() -> None:
    with pytest.raises(UsageError, match="--method onnx needs a net"):
        check_method_and_model("onnx", None)
    with pytest.raises(UsageError, match="takes no --model"):
        check_method_and_model("cwcli", "net.onnx")
    with pytest.raises(UsageError, match="needs a net"):
        METHODS["onnx"].make(0)
