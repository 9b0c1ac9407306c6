"""Runs stages on one log or on many: in this process, in local ones, or on a Ray cluster. Prints nothing."""
