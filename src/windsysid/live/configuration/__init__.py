"""Settings of a live service, and the sources that they describe."""
