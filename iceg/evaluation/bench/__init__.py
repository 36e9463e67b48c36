"""Accuracy and speed on the logs at hand, printed as tables: `python -m iceg.evaluation.bench -o DIR`."""
