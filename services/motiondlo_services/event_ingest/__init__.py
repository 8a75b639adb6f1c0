"""Event ingest: camera or file in, batches on a fixed time grid and triggers out."""
