"""Windows of a stream: from blocks to records, from records to rows."""
