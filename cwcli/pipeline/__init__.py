"""What a stage is: its result, its run record, what it needs, and how stages run on a log one after the other."""
