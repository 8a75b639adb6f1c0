"""The frame branch: segmentation backends, mask to polylines, appearance strips, warp to event pixels."""
