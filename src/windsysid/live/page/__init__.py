"""The page of the live service, and its API."""
