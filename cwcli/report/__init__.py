"""The report: annotated logs as one HTML page that needs no network."""
