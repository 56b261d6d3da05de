"""Memory of training on a long recording at full resolution."""
