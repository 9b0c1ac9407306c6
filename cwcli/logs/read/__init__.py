"""Reading logs: the bytes, the messages, columns, frames and transforms."""
