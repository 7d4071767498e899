"""Output of windsysid: no file of the user is lost, and a result is complete, the old one or the new one."""
