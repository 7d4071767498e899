"""Expected uncertainty of a measurement before it is made."""
