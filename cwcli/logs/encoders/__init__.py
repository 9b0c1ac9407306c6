"""Encodes columns as messages of the published schemas: protobuf and CDR."""
