"""From a file's columns or series to the channels of a record."""
