"""The room of counterfactuals: what a braking controller would have made of a warning (song2016, section 4)."""
