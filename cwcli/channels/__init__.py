"""The published messages: topic, schema, how each is written and read back; which channel fills which role."""
