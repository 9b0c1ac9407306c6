"""The reproduction of song2016: its table and figures from our own scenarios, beside ours, with a verdict each."""
