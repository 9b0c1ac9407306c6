"""How critical two vehicles are to each other, by what they really did: one file a measure."""
