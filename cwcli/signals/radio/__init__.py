"""V2X messages in the packed encoding as radios receive them, from octets to columns."""
