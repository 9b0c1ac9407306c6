"""What the stages read: sensor channels as the columns that the domain rooms take."""
