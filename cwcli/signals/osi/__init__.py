"""ASAM OSI messages (`osi3.*`) of simulators and sensor models, about the host vehicle and all other objects."""
