"""The reproduction of zhang2011: the lanes, the observer and the paths."""
