"""Writing logs: new ones, and copies with more channels."""
