"""How good is what the stages made of a log: one file per stage, headline metrics of `cwcli.metrics.headline`."""
