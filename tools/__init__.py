"""What developers run in a checkout, and the package does not ship: the generated docs and the compiled schemas."""
