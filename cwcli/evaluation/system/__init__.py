"""Another system in the same log: its warnings, paths and states, judged like cwcli's own."""
