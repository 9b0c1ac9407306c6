"""Evaluation of the stages' results on a log, one file per stage; headline metrics of `cwcli.metrics.headline`."""
