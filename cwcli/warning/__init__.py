"""Collision warnings from predicted paths: rules, events, and their scores against what really happened."""
