"""Message encodings: from the payloads of a channel to columns."""
