"""Which measured mode is which mode of a model, with odds."""
