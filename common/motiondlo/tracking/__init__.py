"""The event branch: trackers that turn event batches into node chains, and what they exchange with fusion."""
