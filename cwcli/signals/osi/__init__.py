"""ASAM OSI messages (`osi3.*`): what a simulator or a sensor model says of the host vehicle and of all others."""
