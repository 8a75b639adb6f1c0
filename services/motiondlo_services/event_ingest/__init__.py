"""The event ingest's daemon."""
