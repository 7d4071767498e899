"""What an identification found: estimates, posterior, modes, diagnosis, directions that the data do not see."""
