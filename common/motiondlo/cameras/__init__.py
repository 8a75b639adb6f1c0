"""Cameras: the interface of event and frame cameras, their drivers, and the pairing of frames with triggers."""
