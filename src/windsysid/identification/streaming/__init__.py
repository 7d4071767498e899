"""Identification of records that do not fit into memory, segment by segment."""
