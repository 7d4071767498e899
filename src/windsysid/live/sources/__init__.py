"""Where a live service's blocks come from: a broker, a folder, a SCADA server, a record that is played."""
