"""A turbine as numbers, and the TOML file that says them."""
