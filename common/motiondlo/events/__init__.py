"""Event camera data: the one event dtype, decoders, batches on a fixed time grid, triggers, clocks."""
