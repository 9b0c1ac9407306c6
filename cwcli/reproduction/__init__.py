"""The papers' tables and figures from our own runs, one folder per paper: beside the prints, with a verdict each."""
