"""Pictures: tracked DLOs over RGB frames and over accumulated events. Images are (H, W, 3) uint8 BGR."""
