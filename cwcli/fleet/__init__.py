"""Many logs: which ones, the stages on each in local processes or on a Ray cluster, and what comes out, in a folder."""
