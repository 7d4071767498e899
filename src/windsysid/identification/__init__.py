"""From a record to an estimate: unknowns, load models, the online posterior and its mode."""
