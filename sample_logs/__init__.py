"""Seconds-long logs made by `cwcli simulate`, each with its scenario file and seed."""
