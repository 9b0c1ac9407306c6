"""Targets from lidar and radar: sensor models, filters, smoothers, association, scores (xiang2019)."""
