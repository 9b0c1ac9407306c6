"""How a car moves sideways: single-track model, steering, and the observer of lateral speed and yaw rate."""
