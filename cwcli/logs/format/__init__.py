"""The MCAP format: records, the index of a file, and the chunks in it."""
