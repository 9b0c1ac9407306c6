"""What radios received: V2X messages in the packed encoding, from octets to columns. One file a message."""
