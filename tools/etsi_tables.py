"""Write the tables of ETSI's messages from compiled ASN.1 modules: `python -m tools.etsi_tables`.

`cwcli/signals/radio/*.json` hold ETSI's types as far as the packed encoding sees them; `cwcli.signals.radio.tables`
says how. ETSI's modules are under the 3-clause BSD licence (https://forge.etsi.org/rep/ITS/asn1); the library `pycrate`
ships them compiled.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "cwcli" / "signals" / "radio"
MODULES: dict[str, tuple[str, str, str]] = {
    "cam": ("ITS_CAM_2", "CAM_PDU_Descriptions", "CAM"),
    "denm": ("ITS_DENM_3", "DENM_PDU_Descriptions", "DENM"),
}
"""Message -> module of `pycrate_asn1dir`, ASN.1 module, type."""
UNIT_BITS = {
    "BIT STRING": 1,
    "OCTET STRING": 8,
    "IA5String": 7,
    "VisibleString": 7,
    "UTF8String": 8,
    "NumericString": 4,
}
UNBOUNDED_TEXT = ("UTF8String",)


def node(obj: Any) -> list[Any]:  # noqa: PLR0911 - one for each type
    """The entry of a type."""
    match obj.TYPE:
        case "INTEGER":
            low, high, extensible = bounds(obj._const_val)
            return ["int", low, high, extensible]
        case "BOOLEAN":
            return ["int", 0, 1, False]
        case "ENUMERATED":
            return ["enum", len(obj._root), obj._ext is not None]
        case "NULL":
            return ["null"]
        case "SEQUENCE":
            parts = [[name, node(obj._cont[name]), is_optional(obj._cont[name])] for name in obj._root]
            return ["sequence", parts, obj._ext is not None]
        case "CHOICE":
            return ["choice", [[name, node(obj._cont[name])] for name in obj._root], obj._ext is not None]
        case "SEQUENCE OF":
            low, high, extensible = bounds(obj._const_sz)
            return ["list", node(obj._cont), low or 0, high, extensible]
        case other:
            low, high, extensible = (0, None, False) if other in UNBOUNDED_TEXT else bounds(obj._const_sz)
            return ["sized", UNIT_BITS[other], low or 0, high, extensible]


def bounds(constraint: Any) -> tuple[int | None, int | None, bool]:
    """Lower and upper bound, None where there is none, and whether it is extensible."""
    return (None, None, False) if constraint is None else (constraint.lb, constraint.ub, constraint._ev is not None)


def is_optional(component: Any) -> bool:
    """Whether a component may be left out."""
    return bool(component._opt) or component._def is not None


def table(message: str) -> str:
    """The table of a message."""
    module, unit, name = MODULES[message]
    obj = getattr(getattr(importlib.import_module(f"pycrate_asn1dir.{module}"), unit), name)
    return json.dumps(node(obj), separators=(",", ":")) + "\n"


def main() -> None:
    """Write every table."""
    for message in MODULES:
        (FOLDER / f"{message}.json").write_text(table(message), encoding="utf-8")


if __name__ == "__main__":
    main()
