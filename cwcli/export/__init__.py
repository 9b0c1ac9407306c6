"""Results in the formats of other tools: tables, and tracks for mapping and trajectory tools."""
