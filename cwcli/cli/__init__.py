"""The command line: one file per subcommand, shared options, console, exit codes. No science, no file formats.

Nothing here imports numpy, pyarrow or a domain room at module top: a command imports its stage when it runs.
"""
