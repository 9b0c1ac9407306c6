"""TODO: replaced by its room."""
