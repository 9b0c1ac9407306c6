"""One file a quantity or a family of messages: from the columns of a channel to its canonical signal."""
