"""The version of cwcli, below every room, so that none has to import the package's public face for it."""

__version__ = "0.1.0"
