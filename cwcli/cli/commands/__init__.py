"""One file per subcommand: parse, build one frozen configuration, call a stage, print, return a code.

A command module holds a function `command`, whose docstring is its help page, and `EXAMPLES`, the lines at its end.
"""
