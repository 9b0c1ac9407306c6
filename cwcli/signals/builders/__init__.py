"""Builders from a channel's columns to its canonical signal, one file for each quantity or family of messages."""
