"""The tables in docs/estimation.md, docs/scenarios.md and docs/v2x.md that the code holds (see `tools.reference`)."""

from __future__ import annotations

from collections.abc import Mapping

from cwcli.cli.markdown import format_code, format_markdown_table, replace_marked_block
from cwcli.signals.v2x_tables import Element
from cwcli.simulation.spec import Key


def scenario_page(text: str) -> str:
    """docs/scenarios.md with one table for each group of keys."""
    from cwcli.simulation.spec import (
        COMMON_SENSOR_KEYS,
        DETECTOR_KEYS,
        LATERAL_KEYS,
        LONGITUDINAL_KEYS,
        ORIGIN_KEYS,
        SCENARIO_TOP_LEVEL_KEYS,
        SENSOR_KEYS,
        V2X_KEYS,
        VEHICLE_KEYS,
    )

    tables: dict[str, Mapping[str, Key]] = {
        "top": SCENARIO_TOP_LEVEL_KEYS,
        "origin": ORIGIN_KEYS,
        "vehicle": VEHICLE_KEYS,
        "longitudinal": LONGITUDINAL_KEYS,
        "lateral": LATERAL_KEYS,
        "every sensor": COMMON_SENSOR_KEYS,
        "v2x": V2X_KEYS,
    }
    for sensor, keys in {**SENSOR_KEYS, **DETECTOR_KEYS}.items():
        tables[sensor] = {name: key for name, key in keys.items() if name not in COMMON_SENSOR_KEYS}
    for name, keys in tables.items():
        text = replace_marked_block(text, f"keys: {name}", _key_table(keys))
    return text


def _key_table(keys: Mapping[str, Key]) -> str:
    rows = [(format_code(name), key.permitted_text(), _default_text(key), key.doc) for name, key in keys.items()]
    return format_markdown_table(("key", "permitted", "default", "meaning"), rows)


def _default_text(key: Key) -> str:
    from cwcli.simulation.spec import REQUIRED_KEY_DEFAULT

    if key.default is REQUIRED_KEY_DEFAULT:
        return "required"
    if key.default in (None, ()):
        return "none"
    if isinstance(key.default, bool):
        return str(key.default).lower()
    return f'"{key.default}"' if isinstance(key.default, str) else str(key.default)


def v2x_page(text: str) -> str:
    """docs/v2x.md with one table of data elements for each standard."""
    from cwcli.signals import cpm, etsi, j2735, sdsm

    of_sdsm = {
        name: each
        for name, each in sdsm.DATA_ELEMENTS_BY_SDSM_QUANTITY.items()
        if name not in j2735.DATA_ELEMENTS_BY_BSM_QUANTITY
    }
    for name, elements in (
        ("j2735", j2735.DATA_ELEMENTS_BY_BSM_QUANTITY),
        ("cam", etsi.DATA_ELEMENTS_BY_CAM_OR_VAM_QUANTITY),
        ("cpm", cpm.DATA_ELEMENTS_BY_CPM_QUANTITY),
        ("sdsm", of_sdsm),
    ):
        text = replace_marked_block(text, f"elements: {name}", _element_table(elements))
    return text


def _element_table(elements: Mapping[str, Element]) -> str:
    """The table; without the column "out of range" where no element has such a code."""
    has_out_of_range = any(each.out_of_range for each in elements.values())
    head = ("quantity", "element", "step", "sign", "codes with a value", "unavailable")
    rows = []
    for name, each in elements.items():
        cells = (name, each.element, f"{each.unit:.12g}", f"{each.sign:+d}", f"{each.low}..{each.high}")
        codes = (each.unavailable, each.out_of_range) if has_out_of_range else (each.unavailable,)
        rows.append((*cells, *(", ".join(map(str, some)) or "none" for some in codes)))
    return format_markdown_table((*head, "out of range") if has_out_of_range else head, rows)


def estimation_page(text: str) -> str:
    """docs/estimation.md with the ranges of what is found from a log."""
    from cwcli.estimation import sensor_limits

    ranges = {
        "speed: scale": sensor_limits.SPEED_SCALE_RANGE,
        "speed: lever arm": sensor_limits.ESTIMATED_POINT_ABOVE_SPEED_POINT_RANGE,
        "accelerometer: bias": sensor_limits.ACCEL_BIAS_RANGE,
        "accelerometer: grade": sensor_limits.ROAD_GRADE_ACCEL_SIGMA_RANGE,
        "gyroscope: bias": sensor_limits.YAW_RATE_BIAS_RANGE,
        "position: slow error": sensor_limits.SLOW_POSITION_SIGMA_RANGE,
        "position: stamp jitter (sigma)": sensor_limits.STAMP_SIGMA_RANGE,
        "place ahead": sensor_limits.LONGITUDINAL_LEVER_ARM_RANGE,
        "latency: change in a second": sensor_limits.LATENCY_CHANGE_PER_SECOND_RANGE,
        "latency": sensor_limits.LATENCY_RANGE,
        **{f"white noise: {kind.name.lower()}": each for kind, each in sensor_limits.WHITE_NOISE_RANGE_BY_KIND.items()},
    }
    rows = [(name, f"{each.low:g} to {each.high:g} {each.unit}".rstrip(), each.source) for name, each in ranges.items()]
    return replace_marked_block(text, "bounds", format_markdown_table(("parameter", "range", "why"), rows))
