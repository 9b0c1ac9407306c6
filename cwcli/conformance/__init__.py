"""Conformance: trials of public standards, made as scenarios or found in a log, and judged by numbers as published."""
