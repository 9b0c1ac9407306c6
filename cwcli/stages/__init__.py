"""One file per stage. A stage is a pure function from a log and a configuration to new channels, tables and a summary.

A stage binds roles to channels, loads the columns it needs, calls one domain room and names what comes out. It writes
no file and prints nothing: `cwcli.logs.annotate` and `cwcli.cli` do.
"""
