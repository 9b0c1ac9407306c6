"""The reproduction of xiang2019: its table of errors, its figures, and its claims."""
