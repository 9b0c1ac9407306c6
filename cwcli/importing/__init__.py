"""Import: files that are no logs -> a log that `cwcli estimate` reads without an option.

Design:

1. `readers/`: one file and one line a kind. A reader gives tables of named columns (`tables.SourceTable`), a batch of
   rows at a time, and what its format fixes about them (units, time base). It guesses nothing.
2. `names`, `times`, `units`, `motion`, `axes`: which quantity a column is, in which unit, time base and axes: by the
   format, by the header, by the values, and by comparing tables with the way between the positions. `guess` puts it
   together. Every guess has a confidence and a reason; what the file can't tell is a `Question` with its choices and
   the option that decides. An import with an open question writes nothing.
3. `channels`: quantities -> channels of standard ROS 2 messages, as sensors publish them. `run` writes them.
4. `mapping`: the guesses as a TOML file, which can be edited and given again (`--mapping`).

Only the columns that can be a quantity by their name are loaded, as arrays that may lie on the disk
(`cwcli.array_memory`).
"""
