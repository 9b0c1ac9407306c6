"""Lane boundaries in camera frames: frames, camera geometry, search methods, overlays."""
