"""Recordings of moving cables with exact truth: elastic cables, a rasteriser, a model of an event sensor."""
