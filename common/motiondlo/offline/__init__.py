"""Offline tools: run the cores over a recording, evaluate the result against ground truth, measure their speed."""
