"""The published contract of every channel that cwcli writes (`cwcli/v1/*.proto`), and its compiled form."""
