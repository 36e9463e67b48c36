"""`iceg bench`: methods compared on logs, and accuracy and speed of ICE on those at hand."""
