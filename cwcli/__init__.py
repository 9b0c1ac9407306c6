"""cwcli: from a recorded drive to states, predicted paths and collision warnings."""

__version__ = "0.1.0"
