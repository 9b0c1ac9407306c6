"""Write the tables of V2X messages from compiled ASN.1 modules: `python -m tools.message_tables`.

`cwcli/signals/radio/*.json` hold the types of messages as far as the packed encoding sees them;
`cwcli.signals.radio.program` says how. ETSI's modules are under the 3-clause BSD licence
(https://forge.etsi.org/rep/ITS/asn1). The library `pycrate` ships those of CAM and DENM compiled; of the others, which
it does not have, `tools/asn1` holds the part that is read.
"""

from __future__ import annotations

import importlib
import json
import tempfile
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "cwcli" / "signals" / "radio"
MODULES: dict[str, tuple[str, str, str]] = {
    "cam": ("ITS_CAM_2", "CAM_PDU_Descriptions", "CAM"),
    "denm": ("ITS_DENM_3", "DENM_PDU_Descriptions", "DENM"),
}
"""Message -> module of `pycrate_asn1dir`, ASN.1 module, type."""
SOURCES = Path(__file__).parent / "asn1"
"""The folder with the ASN.1 of the messages that `pycrate` does not have, each with the type named like its file."""
MARKED_TYPES: dict[str, list[Any]] = {"Unread": ["unread"], "Forbidden": ["int", 0, -1, False]}
"""The nodes of the types that stand in these sources for what is not read, and for what must not be there."""
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
    name = obj._typeref.called[1] if getattr(obj._typeref, "called", None) else ""
    if name in MARKED_TYPES:
        return MARKED_TYPES[name]
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
        case "OPEN_TYPE":
            return ["open", [[case["id"], node(case["Type"])] for case in obj._const_tab._val.root]]
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
    if message in MODULES:
        module, unit, name = MODULES[message]
        obj = getattr(getattr(importlib.import_module(f"pycrate_asn1dir.{module}"), unit), name)
    else:
        obj = compiled_source(message)
    return json.dumps(node(obj), separators=(",", ":")) + "\n"


def compiled_source(message: str) -> Any:
    """The type of a message, compiled from its source."""
    from pycrate_asn1c.asnproc import GLOBAL, PycrateGenerator, compile_text, generate_modules

    GLOBAL.clear()
    compile_text((SOURCES / f"{message}.asn").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        generated = Path(folder) / "generated.py"
        generate_modules(PycrateGenerator, str(generated))
        names: dict[str, Any] = {}
        exec(generated.read_text(encoding="utf-8"), names)
    return getattr(names[message.capitalize()], message.upper())


def messages() -> list[str]:
    """The messages that have a table."""
    return [*MODULES, *sorted(path.stem for path in SOURCES.glob("*.asn"))]


def main() -> None:
    """Write every table."""
    for message in messages():
        (FOLDER / f"{message}.json").write_text(table(message), encoding="utf-8")


if __name__ == "__main__":
    main()
