"""Scores, confidence intervals, and the tables that stages and rules return."""
