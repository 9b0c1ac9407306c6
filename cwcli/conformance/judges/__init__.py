"""The judges of trials: one file each, named in a clause's file; no other list of them exists."""
