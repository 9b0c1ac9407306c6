"""What kind of line, and of what colour, the default method takes boundaries for, against what was rendered.

    python -m tests.studies.lane_kinds                          # 24 drives of 4 s
    python -m tests.studies.lane_kinds --seeds 100-123 --road complex

Each drive has a kind and a colour drawn for each side: solid; dashes of 3 + 9, 4 + 6 or 6 + 9 m; raised dots every
3.6 m; two solid stripes; dashes with a solid stripe beside them. The frames are coloured: a yellow line is one that is
darker in blue. Half of the drives have the paper's camera (320 x 240), half a wide one (480 x 270). Counted are found
boundaries from the tenth frame on; a row for each true kind. Seeds below 50 were in sight while it was made.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from cwcli.reproduction.zhang2011.rendered import camera_with_pitch_error
from cwcli.simulation.road.camera import camera_of_zhang2011, wide_camera
from cwcli.simulation.road.defects import DOT_AND_GAP_M, RAISED_DOT_WIDTH_M
from cwcli.simulation.road.drive import RoadDrive, RoadDriveConfig, plan_road_drive
from cwcli.simulation.road.scene import Marking
from cwcli.simulation.streams import random_stream
from cwcli.vision.boundary import LineColour, LineKind
from cwcli.vision.lane_tracker import LaneTracker
from cwcli.vision.method import LaneFit, LaneFrame

RATE_HZ = 10.0
JUDGED_FROM = 10
YELLOW_BLUE = 0.45
"""Blue of yellow paint over its red and green."""
CAST = 0.93
"""Blue of the whole picture: no camera's grey is quite grey."""
WEATHERS = {"good": ("clear", "overcast"), "complex": ("clear", "overcast", "shadow", "rain", "fog", "night")}
DRAWN = {
    "solid": LineKind.SOLID,
    "dashes 3 + 9": LineKind.DASHED,
    "dashes 4 + 6": LineKind.DASHED,
    "dashes 6 + 9": LineKind.DASHED,
    "dots": LineKind.DOTS,
    "double": LineKind.DOUBLE,
    "double, dashed": LineKind.DOUBLE,
}
DASHES = {"3 + 9": (3.0, 9.0), "4 + 6": (4.0, 6.0), "6 + 9": (6.0, 9.0), "dashed": (6.0, 9.0)}


def painted(marking: Marking, name: str) -> Marking:
    """A marking of a name of `DRAWN`."""
    if name == "dots":
        return replace(
            marking, dash_m=DOT_AND_GAP_M, width_m=RAISED_DOT_WIDTH_M, remaining_paint_share=1.0, is_double=False
        )
    dash_m = next((dash for key, dash in DASHES.items() if name.endswith(key)), (0.0, 0.0))
    return replace(marking, dash_m=dash_m, is_double=name.startswith("double"))


Sides = tuple[tuple[str, LineKind], tuple[str, LineKind]]


def planned(seed: int, road: str, seconds: float) -> tuple[RoadDrive, Sides, tuple[LineColour, LineColour]]:
    """A drive, and the kind (with its name) and the colour of both sides."""
    rng = random_stream(seed, "study", "kinds")
    names = list(DRAWN)
    # each kind comes as often on either side
    kinds = names[seed % len(names)], names[int(rng.integers(len(names)))]
    kinds = kinds if rng.random() < 0.5 else kinds[::-1]
    colours = tuple(LineColour.YELLOW if rng.random() < 0.5 else LineColour.WHITE for _ in range(2))
    camera = wide_camera(480, 270) if seed % 2 else camera_of_zhang2011()
    weather = WEATHERS[road][int(rng.integers(len(WEATHERS[road])))]
    config = RoadDriveConfig(
        seed=seed,
        road=road,
        weather=weather,
        duration_s=seconds,
        rate_hz=RATE_HZ,
        speed_mps=float(rng.uniform(8.0, 33.0)),
    )
    drive = plan_road_drive(config, camera)
    scene = drive.scene
    scene = replace(scene, left=painted(scene.left, kinds[0]), right=painted(scene.right, kinds[1]))
    left, right = ((name, DRAWN[name]) for name in kinds)
    return replace(drive, scene=scene), (left, right), (colours[0], colours[1])


def in_colour(drive: RoadDrive, colours: tuple[LineColour, LineColour], index: int) -> np.ndarray:
    """A frame as blue, green and red, shape (height, width, 3)."""
    own = drive.render_frame_at(index).grey
    scene = drive.scene
    for side, colour in zip(("left", "right"), colours, strict=True):
        if colour is LineColour.YELLOW:
            marking = getattr(scene, side)
            scene = replace(scene, **{side: replace(marking, grey=YELLOW_BLUE * marking.grey)})
    blue = replace(drive, scene=scene).render_frame_at(index).grey
    return np.stack([(CAST * blue).astype(np.uint8), own, own], axis=-1)


def watched(drive: RoadDrive, pictures: Iterator[np.ndarray]) -> list[LaneFit]:
    """What the default method finds in a drive's pictures (blue, green, red)."""
    camera, search = camera_with_pitch_error(drive.camera), LaneTracker()
    made = []
    for number, picture in enumerate(pictures):
        stamp_ns = round(float(drive.time_s[number]) * 1e9)
        grey = np.ascontiguousarray(picture[..., 1])
        colour = picture if number % 10 == 0 else None
        made.append(search.step(LaneFrame(grey, camera, stamp_ns, number, colour=colour)))
    return made


def one(
    seed: int, road: str, seconds: float
) -> tuple[Counter[tuple[str, LineKind]], Counter[tuple[LineColour, LineColour]]]:
    """How often each kind and each colour was taken for which."""
    drive, names, colours = planned(seed, road, seconds)
    pictures = (in_colour(drive, colours, k) for k in range(len(drive)))
    kinds: Counter[tuple[str, LineKind]] = Counter()
    hues: Counter[tuple[LineColour, LineColour]] = Counter()
    for fit in watched(drive, pictures)[JUDGED_FROM:]:
        for side, (name, _), colour in zip((fit.left, fit.right), names, colours, strict=True):
            if side.found:
                kinds[name, side.kind] += 1
                hues[colour, side.colour] += 1
    return kinds, hues


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0-23", help="first and last")
    parser.add_argument("--road", default="good", choices=WEATHERS)
    parser.add_argument("--seconds", type=float, default=4.0)
    given = parser.parse_args()
    first, last = (int(part) for part in given.seeds.split("-"))
    kinds: Counter[tuple[str, LineKind]] = Counter()
    hues: Counter[tuple[LineColour, LineColour]] = Counter()
    for seed in range(first, last + 1):
        more_kinds, more_hues = one(seed, given.road, given.seconds)
        kinds += more_kinds
        hues += more_hues
    print("| rendered | boundaries | " + " | ".join(kind.name.lower() for kind in LineKind) + " |")
    for name in DRAWN:
        print(_row(name, [kinds[name, kind] for kind in LineKind]))
    print("\n| rendered | boundaries | " + " | ".join(colour.name.lower() for colour in LineColour) + " |")
    for colour in (LineColour.WHITE, LineColour.YELLOW):
        print(_row(colour.name.lower(), [hues[colour, seen] for seen in LineColour]))


def _row(name: str, counts: list[int]) -> str:
    total = max(sum(counts), 1)
    return f"| {name} | {sum(counts)} | " + " | ".join(f"{100 * count / total:.1f} %" for count in counts) + " |"


if __name__ == "__main__":
    main()
