"""The papers' tables and figures from our own runs, one folder per paper: next to the printed values, with a verdict each."""
