"""Distribution of the records of a fleet over processes."""
