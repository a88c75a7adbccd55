"""Record types: fields with ranges, the data dictionary, status codes."""
