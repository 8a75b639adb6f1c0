"""The messages that daemons exchange: strict models, msgpack on the wire, JSON Schemas for everyone else."""
