"""Faults of a record, one module each: of its clock, of single channels, and of the order of its rows."""
