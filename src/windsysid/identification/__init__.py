"""From a record to an estimate: what is unknown, what the loads are, the posterior on line and its mode."""
