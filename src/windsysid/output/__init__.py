"""How windsysid writes: nothing of the user's is lost, and a result is there whole, the old one or the new one."""
