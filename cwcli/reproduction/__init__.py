"""The papers' tables and figures from our own runs, one folder per paper: each printed number with ours and a verdict."""
