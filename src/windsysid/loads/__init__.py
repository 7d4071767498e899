"""Load models: random processes, where they act, and the hypotheses that a record chooses among."""
