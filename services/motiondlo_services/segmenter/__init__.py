"""The segmenter: turns a frame into the polylines of the DLOs in it."""
