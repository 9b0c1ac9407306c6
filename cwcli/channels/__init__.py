"""The published messages: topic, schema, how each is written, and how it is read back."""
