"""`osi3.GroundTruth`: the host vehicle, and all others."""

from __future__ import annotations

from cwcli.signals.osi.roles import build_pose, build_remote, build_speed, build_target_truth

__all__ = ["build_pose", "build_remote", "build_speed", "build_target_truth"]
