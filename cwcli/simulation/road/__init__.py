"""A road renderer: camera frames of a lane, with exact truth. Plain arrays; OpenCV only inside functions."""
