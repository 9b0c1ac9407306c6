"""Mutated logs and messages against the reader: `python -m tests.fuzz --help`.

An input is one mutated message given to a decoder (level `kernel`), one mutated log given to the reader and now and
then to a command (level `file`), or one mutated OSI trace given to a command (level `osi`). Inputs are made in cases
of several; a case follows from the seed and its number, so
that each can be made again. What must hold of every input:

- a documented exit code and never that of a bug; at the kernel level, no error but the decoder's own;
- at most 10 s of processor time, and no memory error (with `--sanitize`, none that AddressSanitizer or UBSan knows);
- where the official reader or decoder accepts it and cwcli does too, the same values.
"""
