"""Compile `schemas/cwcli/v1/*.proto` to the descriptor set that cwcli ships.

Development only (needs grpcio-tools): `python -m tools.compile_schemas` in a checkout.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from cwcli.logs.encoders.schemas import CWCLI_DESCRIPTOR_SET_FILE, schema_folder


def compile_schemas(folder: Path) -> bytes:
    """The serialised `FileDescriptorSet` of every `.proto` file below `folder`, in order of their names.

    Raises:
        RuntimeError: The compiler refused a file; it has said why on stderr.
        SystemExit: There is no compiler.
    """
    try:
        from grpc_tools import protoc
    except ImportError:
        raise SystemExit("the compiler is missing: pip install -e '.[dev]', or grpcio-tools alone") from None
    sources = sorted(str(path.relative_to(folder)) for path in folder.glob("cwcli/v1/*.proto"))
    with tempfile.TemporaryDirectory() as scratch:
        compiled = Path(scratch) / CWCLI_DESCRIPTOR_SET_FILE
        arguments = ["protoc", f"--proto_path={folder}", f"--descriptor_set_out={compiled}", "--include_imports"]
        if protoc.main([*arguments, *sources]) != 0:
            raise RuntimeError("protoc failed")
        return compiled.read_bytes()


def main() -> int:
    """Write the descriptor set beside the sources."""
    folder = Path(str(schema_folder()))
    target = folder / CWCLI_DESCRIPTOR_SET_FILE
    target.write_bytes(compile_schemas(folder))
    print(f"wrote {target}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
