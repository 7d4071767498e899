"""From a record to the samples that are fitted."""
