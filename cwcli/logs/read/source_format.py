"""What a recording was before its conversion to MCAP."""

from __future__ import annotations

from dataclasses import field

from cwcli.lazy_dataclass import dataclass


@dataclass
class SourceFormat:
    """What a file was before its conversion to MCAP; filled while it is read.

    Attributes:
        name: Name of the format, with its article.
        compressions: Compressions that occur in the file, each once, in order of first use.
        n_chunks: Number of chunks; 0 for a format without chunks.
        notes: What could not be converted, as text -> how often.
    """

    name: str
    compressions: list[str] = field(default_factory=list)
    n_chunks: int = 0
    notes: dict[str, int] = field(default_factory=dict)

    def add_compression(self, name: str) -> None:
        """Add a compression that occurs in the file; repetitions and "" (none) are left out."""
        if name and name not in self.compressions:
            self.compressions.append(name)
