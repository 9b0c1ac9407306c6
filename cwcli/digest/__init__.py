"""What a drive or a run came to, in a few lines: one text for the terminal, the page and Markdown."""
