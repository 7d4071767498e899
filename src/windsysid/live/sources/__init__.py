"""Sources of blocks for a live service: broker, folder, SCADA server, or a record that is replayed."""
